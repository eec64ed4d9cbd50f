"""What no adjustment mends: poses that do not fit the others, wrong boards, a wrong scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.adjustment.bundle import Estimate, adjust, rms
from ftp_dent_ros.calibration.adjustment.holding_out import camera_alone
from ftp_dent_ros.calibration.adjustment.model import Model
from ftp_dent_ros.calibration.adjustment.start import FEWEST_POSES
from ftp_dent_ros.calibration.observing.observation import Observation
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.rig.rig import Rig

# A pose whose residuals are this many times those of the others was not seen as it was.
_BAD_POSE = 4.0
_BAD_POSE_PX = 0.5
# The tape measures the distance between two lenses to a centimetre, or to this part.
_TAPE, _TAPE_SHARE = 0.01, 0.05
# No rig fits its own photographs worse than this; joint, pixels.
_HOPELESS = 5.0


def without_bad_poses(
    used: list[Observation], points: NDArray, estimate: Estimate
) -> tuple[list[Observation], Estimate, dict[str, str]]:
    """Leave out poses that fit far worse than the others, one by one, the worst first."""
    excluded: dict[str, str] = {}
    while len(used) > FEWEST_POSES + 1:
        each = [rms([residuals]) for residuals in estimate.residuals]
        joint = np.array([part[2] for part in each])
        worst = int(np.argmax(joint))
        limit = max(_BAD_POSE * float(np.median(joint)), _BAD_POSE_PX)
        if joint[worst] <= limit:
            break
        alone = camera_alone(used, points, estimate, np.array([worst])).rms()[0]
        blame = (
            'the projector coordinates: the board or the rig moved between its photographs, or '
            'they are out of order'
            if alone <= limit / 2
            else 'the corners: another board, bent, or seen in a mirror'
        )
        excluded[used[worst].name] = (
            f'left out: {joint[worst]:.1f} pixels off where the others are '
            f'{np.median(joint):.2f}; what does not fit are {blame}'
        )
        kept = [index for index in range(len(used)) if index != worst]
        used = [used[index] for index in kept]
        estimate = adjust(used, points, estimate.rig, estimate.poses[kept], Model())
    return used, estimate, excluded


def refuse_hopeless(estimate: Estimate) -> None:
    """Raise `CalibrationError` where no rig fits the poses, with what does not."""
    camera, projector, joint = estimate.rms()
    if joint <= _HOPELESS:
        return
    blame = (
        "the projector coordinates: their photographs are out of order, or the projector's size "
        'is wrong'
        if projector > 2 * camera
        else 'the corners: rows and columns of the board exchanged, or another board'
    )
    raise CalibrationError(
        f'no rig fits these poses: {joint:.1f} pixels are left (camera {camera:.1f}, projector '
        f'{projector:.1f}); what does not fit are {blame}'
    )


def refuse_wrong_scale(rig: Rig, baseline: float) -> None:
    """Raise `CalibrationError` where the lenses are not as far apart as the tape says, metres."""
    found = float(np.linalg.norm(rig.translation))
    if baseline and abs(found - baseline) > max(_TAPE, _TAPE_SHARE * baseline):
        raise CalibrationError(
            f'the lenses come out {1e3 * found:.0f} mm apart, and {1e3 * baseline:.0f} mm were '
            f'measured: if the tape is right, a square is {baseline / found:.3f} times what was '
            'given: measure the print over ten squares'
        )
