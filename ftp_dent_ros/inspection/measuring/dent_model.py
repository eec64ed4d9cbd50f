"""The dent function (eq. 18) fitted to a deviation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.inspection.measuring.patch import Mask, Patch
from ftp_dent_ros.inspection.measuring.sizes import LEVEL, Sizes

# Cells that the function is fitted to, at most: for speed.
_CELLS = 400
# Eq. 18 at 10 % of its depth, as a part of its axes.
_OF_AXES = math.sqrt(1 - 1 / (1 - math.log(LEVEL)))
# exp(1 - 1/q) and its slopes vanish below.
_RIM = 2e-2
# Of a normal matrix whose diagonal is 1.
_RIDGE = 1e-9

Field = NDArray[np.float64]


def dent_function(parameters: Field, x: Field, y: Field) -> Field:
    """Eq. 18, ``depth * exp(1 - 1 / (1 - r^2))`` inside an ellipse, at x, y.

    Parameters
    ----------
    parameters : ndarray, shape (6,)
        x, y, logarithms of the half axes (metres), angle (radians), depth (metres).
    x, y : ndarray, shape (n,)
        Metres.
    """
    at_x, at_y, first, second, angle, depth = parameters
    c, s = math.cos(angle), math.sin(angle)
    u = (c * (x - at_x) + s * (y - at_y)) / math.exp(first)
    v = (c * (y - at_y) - s * (x - at_x)) / math.exp(second)
    inside = 1 - u * u - v * v
    return np.where(inside > _RIM, depth * np.exp(1 - 1 / np.maximum(inside, _RIM)), 0.0)


def model_axes(patch: Patch, region: Mask | None, sizes: Sizes) -> tuple[Estimate, Estimate]:
    """Full axes of the dent function that lies closest to a dent, the longer first.

    Neighbours are left out. Not measured where the patch does not determine the function.
    """
    cells = np.flatnonzero(patch.known if region is None else patch.known & region)
    cells = cells[:: 1 + len(cells) // _CELLS]
    x, y, depth = (each.ravel()[cells] for each in (patch.x, patch.y, patch.depth))
    half = (math.log(max(each.value, 1e-6) / 2 / _OF_AXES) for each in (sizes.length, sizes.width))
    start = [*sizes.outline.centre, *half, sizes.angle.value, sizes.depth.value]
    scale = [sizes.width.value, sizes.width.value, 1.0, 1.0, 1.0, sizes.depth.value]
    nothing = Estimate(math.nan, math.nan)
    if len(cells) < 2 * len(start):
        return nothing, nothing
    fit = least_squares(
        lambda each: (dent_function(each, x, y) - depth) / sizes.depth.value,
        start,
        x_scale=scale,
        ftol=1e-4,
        max_nfev=30,
    )
    size = np.linalg.norm(fit.jac, axis=0)
    size[4] = max(size[4], 1e-9)  # the angle of what is round is free, and nothing else may be
    if not fit.success or not size.all():
        return nothing, nothing
    normal = fit.jac.T @ fit.jac / np.outer(size, size) + _RIDGE * np.eye(len(size))
    spread = 2 * fit.cost / (len(cells) - len(start))
    variance = spread * np.linalg.inv(normal).diagonal() / size**2
    axes = [
        Estimate(
            2 * math.exp(fit.x[k]),
            math.hypot(2 * math.exp(fit.x[k]) * math.sqrt(variance[k]), of.uncertainty),
        )
        for k, of in ((2, sizes.length), (3, sizes.width))
    ]
    first, second = sorted(axes, key=lambda each: -each.value)
    return first, second
