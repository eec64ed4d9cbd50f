"""How finely the places of a cloud are kept: in steps of their own noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.coding.view import View

# Of a point's stated uncertainty, for the step of its depth: the error is half a step at most, and
# what single precision rounds.
PART = 0.9
# 1/m, where no uncertainty is stated: 0.4 um at 0.6 m, 1.4 um at 1.2 m, which is 0.0003 rad of
# the shipped rig's fringes, half of the noise of its best photographs.
STEP_UNKNOWN = 1e-6
# 1/m: at 1 m what a float32 resolves.
_FINEST = 1e-7
# Points off the lens's rays by more than this part of their depth are not its camera's.
_OFF_THE_RAY = 1e-6


def is_on_rays(
    points: NDArray[np.float32], depth: NDArray[np.float32], valid: NDArray[np.bool_], view: View
) -> bool:
    """Whether all valid points (rows, columns, 3) lie on the view's rays, ahead of the camera."""
    if view.shape != valid.shape:
        return False
    count = np.count_nonzero(valid)
    if np.count_nonzero((depth > 0) & valid) != count:
        return False
    with np.errstate(invalid='ignore', over='ignore'):
        bound = depth * np.float32(_OFF_THE_RAY)
        for axis, ray in enumerate(view.rays()):
            off = points[..., axis].copy()
            off -= ray * depth
            np.abs(off, out=off)
            if np.count_nonzero((off <= bound) & valid) != count:
                return False
    return True


def inverse_step(
    depth: NDArray[np.float32],
    sigma: NDArray[np.float32],
    valid: NDArray[np.bool_],
    view: View,
    part: float,
) -> float:
    """Step of 1/z, by the point whose uncertainty is the smallest in it.

    A change of 1/z by d moves a point p along its ray by ``|p| z d``.
    """
    known = valid & (sigma > 0)
    if not known.any():
        return STEP_UNKNOWN * part
    with np.errstate(all='ignore'):
        noise = sigma / (view.lengths() * depth * depth)
    return max(float(noise.min(where=known, initial=np.inf)) * part, _FINEST)


def linear_step(
    points: NDArray[np.float32],
    sigma: NDArray[np.float32],
    valid: NDArray[np.bool_],
    part: float,
) -> float:
    """Step of x, y and z, metres."""
    known = valid & (sigma > 0)
    if known.any():
        return max(float(sigma[known].min()) * part / math.sqrt(3), _FINEST)
    return STEP_UNKNOWN * part
