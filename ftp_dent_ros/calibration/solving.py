"""From correspondences to a rig: start, adjust, choose the terms, hold out, say how good it is."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros import __version__
from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import (
    DISTORTIONS,
    LENS,
    Adjustment,
    Model,
    adjust,
    covariance,
    depths,
    rig_vector,
    rms,
)
from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.calibration.start import FEWEST_POSES, first_rig
from ftp_dent_ros.errors import CalibrationError, RigError
from ftp_dent_ros.rig.calibration_record import PARAMETERS, CalibrationRecord
from ftp_dent_ros.rig.geometry import check_geometry
from ftp_dent_ros.rig.rig import Rig

# Scores differ by more than this part.
_TOLERANCE = 1e-5
#: Values that are tried of each field of a model, one field after the other.
_TRIED: dict[str, Iterable[int]] = {
    'bent': (False, True),
    'projector': range(len(DISTORTIONS)),
    'camera': range(len(DISTORTIONS)),
}
#: How often `solve` tells its progress at most: of what is tried, one is the best so far.
STEPS = 1 + sum(len(tuple(values)) - 1 for values in _TRIED.values())


def select(estimate: Adjustment, progress: Callable[[], object]) -> Model:
    """Choose distortion terms, and whether the board is bent, by cross-validation.

    Parameters
    ----------
    estimate : Adjustment
        With all terms: where each candidate starts.
    progress : callable
        Called after each candidate.
    """

    @cache
    def score(candidate: Model) -> float:
        found = held_out_score(estimate, candidate)
        progress()
        return found

    best = Model()
    for name, values in _TRIED.items():
        tried = [replace(best, **{name: value}) for value in values]  # type: ignore[arg-type]
        best = min(tried, key=score)
    return best


def held_out_score(estimate: Adjustment, candidate: Model) -> float:
    """Mean squared residual of poses that a candidate was not fitted to, over its variance."""
    seen = held_out(estimate, candidate, 4)
    if not seen:
        return 0.0
    residuals = np.concatenate([each.residuals for each in seen])
    off = residuals / np.repeat(np.array(estimate.deviations), 2)
    # Gross errors must not decide, standard deviations.
    return float(np.nanmean(np.square(np.clip(off, -3, 3))))


def held_out(estimate: Adjustment, candidate: Model, wanted: int) -> list[Adjustment]:
    """Each part of the poses with a rig of the others, whose poses place the board alone.

    There are as many parts as wanted or, of few poses, more; none if too few would be left.
    """
    count, found = len(estimate.poses), []
    # Fewer poses than three left for fitting do not hold a rig down.
    enough = (parts for parts in range(wanted, count + 1) if count - -(-count // parts) >= 3)
    parts = next(enough, 0)
    for first in range(parts):
        out = np.arange(count) % parts == first
        fitted = adjust(estimate.of_poses(np.flatnonzero(~out)), candidate, _TOLERANCE)
        start = replace(estimate.of_poses(np.flatnonzero(out)), rig=fitted.rig, bend=fitted.bend)
        found.append(adjust(start, None, _TOLERANCE))
    return found


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What poses say of a rig that was fitted to the others, half by half.

    Attributes
    ----------
    rms : tuple of 3 floats
        Camera, projector and both, pixels.
    stereo_rms : float
        Of the projector, with the board's place by the camera alone; pixels.
    depth_errors : ndarray, shape (m,)
        Of every corner: its triangulated depth less that of the board's plane; metres.
    depths : ndarray, shape (m,)
        Of the corners, metres.
    """

    rms: tuple[float, float, float]
    stereo_rms: float
    depth_errors: NDArray[np.float64]
    depths: NDArray[np.float64]


def hold_out(estimate: Adjustment, model: Model) -> HeldOut | None:
    """Fit to each half of the poses and look at the other; None if there are too few."""
    residuals, stereo, errors, places = [], [], [], []
    for seen in held_out(estimate, model, 2):
        residuals.append(seen.residuals)
        rig = seen.rig
        found = camera_alone(replace(seen, bend=estimate.bend)).points()
        camera, projector = np.split(seen.observed, 2, axis=-1)
        stereo.append(projector - rig.projector.project(rig.to_projector(found)))
        known = np.isfinite(seen.observed[..., :3]).all(axis=-1)
        places.append(found[known][:, 2])
        errors.append(depths(rig, camera[known], projector[known][:, 0]) - places[-1])
    if not residuals:
        return None
    square = np.square(np.concatenate(stereo)).sum(axis=-1)
    return HeldOut(
        rms(np.concatenate(residuals)),
        float(np.sqrt(np.nanmean(square))),
        np.concatenate(errors),
        np.concatenate(places),
    )


def camera_alone(start: Adjustment) -> Adjustment:
    """Poses as the camera alone tells them, with a rig that is known."""
    seen = [replace(o, projector=np.full_like(o.projector, np.nan)) for o in start.observations]
    return adjust(replace(start, observations=seen), None)


def without_bad_poses(estimate: Adjustment) -> tuple[Adjustment, dict[str, str]]:
    """Leave out poses that fit far worse than the others, one by one, the worst first."""
    excluded: dict[str, str] = {}
    while len(estimate.poses) > FEWEST_POSES + 1:
        joint = np.array([rms(residuals)[2] for residuals in estimate.residuals])
        worst = int(np.argmax(joint))
        # A pose whose residuals are this many times those of the others was not seen as it was.
        limit = max(4.0 * float(np.median(joint)), 0.5)
        if joint[worst] <= limit:
            break
        bad = estimate.of_poses(np.array([worst]))
        blame = (
            'the projector coordinates: the board or the rig moved between its photographs, or '
            'they are out of order'
            if camera_alone(bad).rms()[0] <= limit / 2
            else 'the corners: another board, bent, or seen in a mirror'
        )
        excluded[bad.observations[0].name] = (
            f'left out: {joint[worst]:.1f} pixels off where the others are '
            f'{np.median(joint):.2f}; what does not fit are {blame}'
        )
        others = estimate.of_poses(np.delete(np.arange(len(joint)), worst))
        estimate = adjust(replace(others, deviations=None), Model())
    return estimate, excluded


def refuse_hopeless(estimate: Adjustment) -> None:
    """Raise `CalibrationError` where no rig fits the poses, with what does not."""
    camera, projector, joint = estimate.rms()
    # No rig fits its own photographs worse than this; joint, pixels.
    if joint <= 5.0:
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
    # The tape measures the distance between two lenses to a centimetre, or to this part.
    if baseline and abs(found - baseline) > max(0.01, 0.05 * baseline):
        raise CalibrationError(
            f'the lenses come out {1e3 * found:.0f} mm apart, and {1e3 * baseline:.0f} mm were '
            f'measured: if the tape is right, a square is {baseline / found:.3f} times what was '
            'given: measure the print over ten squares'
        )


@dataclass(frozen=True, eq=False)
class Solution:
    """A calibrated rig and what is known about it.

    Attributes
    ----------
    rig : Rig
        With its record and covariance.
    estimate : Adjustment
        Of the poses that were used.
    model : Model
    held_out : HeldOut or None
        None if there were too few poses.
    excluded : dict of str to str
        Poses left out, and why.
    remarks : list of str
    """

    rig: Rig
    estimate: Adjustment
    model: Model
    held_out: HeldOut | None
    excluded: dict[str, str]
    remarks: list[str]


def solve(
    observations: list[Observation],
    board: Board,
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
    baseline: float = 0.0,
    model: Model | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Solution:
    """Calibrate a rig.

    Parameters
    ----------
    observations : list of Observation
        Of this tool or any other.
    board : Board
    camera_size, projector_size : (int, int)
        Width and height, pixels.
    baseline : float
        Distance between the two lenses by the tape, metres; 0 if it was not measured. Nothing
        else tells a wrong size of the squares.
    model : Model, optional
        The terms to estimate; chosen by cross-validation if left out.
    progress : callable
        Called after each candidate among which the terms are chosen, `STEPS` at most.

    Raises
    ------
    CalibrationError
        The observations give no rig; the message says what is wrong with them.
    """
    start = first_rig(observations, board.points, camera_size, projector_size)
    estimate, excluded = without_bad_poses(adjust(start, Model()))
    refuse_hopeless(estimate)
    refuse_wrong_scale(estimate.rig, baseline)
    model = model or select(estimate, progress)
    estimate = adjust(replace(estimate, deviations=None), model)
    known = covariance(estimate, model)
    _refuse_unknown(estimate, known)
    checked = hold_out(estimate, model)
    rig = replace(estimate.rig, record=_record(estimate, known, board, checked))
    remarks = _remarks(estimate, baseline, checked)
    return Solution(rig, estimate, model, checked, excluded, remarks)


def _refuse_unknown(estimate: Adjustment, known: NDArray) -> None:
    """Raise `CalibrationError` where the covariance leaves a focal length or the pose open."""
    deviation = np.sqrt(np.diag(known))
    vector = rig_vector(estimate.rig)
    # Of focal lengths a twentieth; of the lenses' distance a tenth.
    words = [
        f'{PARAMETERS[i]} {vector[i]:.0f} +- {deviation[i]:.0f} pixels'
        for i in (0, 1, LENS, LENS + 1)
        if not deviation[i] < 0.05 * vector[i]
    ]
    baseline, off = np.linalg.norm(vector[21:]), np.linalg.norm(deviation[21:])
    if not off < 0.1 * baseline:
        words.append(f'the distance of the lenses {1e3 * baseline:.0f} +- {1e3 * off:.0f} mm')
    if words:
        raise CalibrationError(
            f'{len(estimate.poses)} poses leave the rig open ({", ".join(words)}, standard '
            'deviations): photograph more poses, close and far, with the board tilted by 20 to '
            '35 degrees to each side'
        )


def _record(
    estimate: Adjustment, known: NDArray, board: Board, checked: HeldOut | None
) -> CalibrationRecord:
    kind = f'ChArUco {board.dictionary}' if board.dictionary else 'chessboard'
    far = estimate.points()[..., 2]
    now = datetime.datetime.now(datetime.timezone.utc)
    return CalibrationRecord(
        id=estimate.rig.id,
        date=now.strftime('%Y-%m-%dT%H:%M:%SZ'),
        tool=f'ftp-dent calibrate solve {__version__}',
        board=f'{kind}, {board.columns}x{board.rows} inner corners, {1e3 * board.square:g} mm',
        poses=len(estimate.poses),
        rms_px=_named(estimate.rms()),
        held_out_rms_px=_named(checked.rms) if checked else {},
        depth_range=(round(float(far.min()), 4), round(float(far.max()), 4)),
        covariance=known,
    )


def _named(rms_px: tuple[float, ...]) -> dict[str, float]:
    names = ('camera', 'projector', 'joint')
    return {name: round(value, 4) for name, value in zip(names, rms_px, strict=True)}


def _remarks(estimate: Adjustment, baseline: float, checked: HeldOut | None) -> list[str]:
    remarks = []
    try:
        check_geometry(estimate.rig)
    except RigError as reason:
        remarks.append(f'this rig is known now, but it cannot measure: {reason}')
    if not baseline:
        found = 1e3 * float(np.linalg.norm(estimate.rig.translation))
        remarks.append(
            f'the lenses come out {found:.0f} mm apart: check it with a tape, for nothing else '
            'tells a wrong size of the squares (--baseline does it for you)'
        )
    if checked is None:
        remarks.append('too few poses to hold half of them out: take 15')
    tilts = np.degrees(np.linalg.norm(estimate.poses[:, :2], axis=1))
    if np.median(tilts) < 10:
        remarks.append('the board was hardly tilted: tilt it by 20 to 35 degrees')
    return remarks
