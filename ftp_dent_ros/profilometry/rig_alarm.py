"""When the checks of successive clouds mean that the rig has moved.

A cloud tells against the rig where its light lies farther beside the epipolar lines than a
calibration errs, by so much more that scatter of the blocks would do it in one of `ONE_IN`
scenes. Clouds of one scene err alike, so that more of them make nothing surer: that several must
agree is only against the odd one, and the odds of a false alarm are those of one cloud.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy.special import stdtrit

from ftp_dent_ros.profilometry.epipolar_check import EpipolarCheck

#: Clouds that are looked back on, and how many of them must agree.
LAST, AGREEING = 5, 3
#: Scenes of a true rig in one of which a cloud tells against it, if blocks scatter normally.
ONE_IN = 200_000
#: What a good calibration leaves between light and epipolar lines, projector pixels, in the middle
#: and at the places that turn and stretch are seen by.
TOLERANCE = 0.05
# Unknowns of the fit.
_FITTED = 3


def off(check: EpipolarCheck) -> tuple[int, int, int]:
    """Whether a cloud tells of a shift, a turn, a stretch: their signs, 0 where it does not."""
    if not check.seen:
        return 0, 0, 0
    freedom = check.places - _FITTED
    # Two sides of three figures.
    sure = float(stdtrit(freedom, 1 - 1 / ONE_IN / 6))

    def sign(value: float, deviation: float) -> int:
        return int(math.copysign(abs(value) > TOLERANCE + sure * deviation, value))

    return (
        sign(check.shift, check.shift_deviation),
        sign(check.reach * check.turn, check.reach * check.turn_deviation),
        sign(check.height * check.stretch, check.height * check.stretch_deviation),
    )


def rig_alarm(checks: Sequence[EpipolarCheck]) -> str:
    """What is wrong with the rig by the last clouds, the newest last; empty if nothing is sure.

    Parameters
    ----------
    checks : sequence of EpipolarCheck
        Of successive clouds; only the `LAST` ones are looked at.
    """
    last = list(checks)[-LAST:]
    signs = [off(check) for check in last]
    for figure in range(3):
        for sign in (1, -1):
            agreeing = [
                check for check, each in zip(last, signs, strict=True) if each[figure] == sign
            ]
            if len(agreeing) >= AGREEING:
                return (
                    f'the rig does not hold: {agreeing[-1].sentence}: check the pattern, and what '
                    'holds camera and projector, and calibrate again'
                )
    return ''
