"""When the checks of successive clouds mean that the rig has moved.

The last clouds tell together: their mean is known better than each, by as much as they differ from
one another. What they have in common does not part them: where they scatter by less than
each is stated to be uncertain by, the rest is taken for an error that all share, such as that of
a skin over which the drone hovers. They tell against the rig where light lies farther
beside the epipolar lines than a calibration errs, by so much more that scatter would do it in
one of `ONE_IN` scenes (`checks/epipolar.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.checks.epipolar import EpipolarCheck

#: Clouds that are looked back on; most of them must be seen.
LAST = 5
#: What stays between light and epipolar lines, projector pixels, in the middle and at the places
#: that turn and stretch are seen by: of a good calibration 0.025, of rows through windows 0.015.
TOLERANCE = 0.04


def joint(checks: Sequence[EpipolarCheck]) -> NDArray[np.float64]:
    """Shift, turn and stretch by several clouds, and their standard deviations.

    Parameters
    ----------
    checks : sequence of EpipolarCheck

    Returns
    -------
    ndarray, shape (2, 3)
        Projector pixels, turn and stretch at the places that they are seen by.
    """
    values, deviations = np.array([check.figures for check in checks]).swapaxes(0, 1)
    weight = 1 / np.square(deviations)
    total = weight.sum(axis=0)
    mean = (weight * values).sum(axis=0) / total
    count = len(checks)
    stated = count / total
    scatter = (weight * np.square(values - mean)).sum(axis=0) / total * count / max(count - 1, 1)
    return np.stack([mean, np.sqrt(scatter / count + np.maximum(stated - scatter, 0))])


def off(checks: Sequence[EpipolarCheck]) -> bool:
    """Whether clouds together tell of a shift, a turn or a stretch."""
    sure = max(check.sure for check in checks)
    mean, deviation = joint(checks)
    return bool((np.abs(mean) > TOLERANCE + sure * deviation).any())


def rig_alarm(checks: Sequence[EpipolarCheck]) -> str:
    """What is wrong with the rig by the last clouds, the newest last; empty if nothing is sure.

    Parameters
    ----------
    checks : sequence of EpipolarCheck
        Of successive clouds; only the `LAST` ones are looked at.
    """
    last = [check for check in list(checks)[-LAST:] if check.seen]
    if 2 * len(last) < LAST or not off(last):
        return ''
    return (
        f'the rig does not hold: {last[-1].sentence}: check the pattern, and what '
        'holds camera and projector, and calibrate again'
    )
