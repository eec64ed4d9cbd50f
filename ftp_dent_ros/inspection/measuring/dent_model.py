"""The dent function (eq. 18) fitted to a deviation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.inspection.measuring.lattice import FEW, LEVEL
from ftp_dent_ros.inspection.measuring.patch import Patch
from ftp_dent_ros.inspection.measuring.sizes import Sizes

# Eq. 18 at 10 % of its depth, as a part of its axes.
_OF_AXES = math.sqrt(1 - 1 / (1 - math.log(LEVEL)))
#: What is not measured.
UNKNOWN = Estimate(math.nan, math.nan)

Field = NDArray[np.float64]


def dent_function(parameters: Field, x: Field, y: Field) -> Field:
    """Eq. 18, ``depth * exp(1 - 1 / (1 - r^2))`` inside an ellipse, at x, y.

    Parameters
    ----------
    parameters : ndarray, shape (6,), or (6, m, 1) of several functions
        x, y (metres), inverse half axes (1 / metres), angle (radians), depth (metres).
    x, y : ndarray, shape (n,)
        Metres.
    """
    at_x, at_y, first, second, angle, depth = parameters
    c, s = np.cos(angle), np.sin(angle)
    u = (c * (x - at_x) + s * (y - at_y)) * first
    v = (c * (y - at_y) - s * (x - at_x)) * second
    inside = np.maximum(1 - u * u - v * v, np.finfo(float).eps)
    return np.asarray(depth * np.exp(1 - 1 / inside))


def model_axes(patch: Patch, sizes: Sizes) -> tuple[Estimate, Estimate]:
    """Full axes of the dent function that lies closest to a dent, the longer first.

    Not measured where the patch does not determine the function.
    """
    cells = np.flatnonzero(patch.known)
    cells = cells[np.linspace(0, len(cells) - 1, min(FEW, len(cells))).astype(int)]
    x, y, depth = (each.ravel()[cells] for each in (patch.x, patch.y, patch.depth))
    inverse = (2 * _OF_AXES / each.value for each in (sizes.length, sizes.width))
    start = [*sizes.outline.centre, *inverse, sizes.angle.value, sizes.depth.value]
    if len(cells) < 2 * len(start):
        return UNKNOWN, UNKNOWN

    def off(parameters: Field) -> Field:
        return dent_function(parameters, x, y) - depth

    def slopes(parameters: Field) -> Field:
        # SciPy's own differences, of all parameters at once: one by one takes twice as long.
        moved = parameters + np.diag(
            math.sqrt(np.finfo(float).eps)
            * np.copysign(np.maximum(1, np.abs(parameters)), parameters)
        )
        return (off(moved.T[..., None]) - off(parameters)).T / (moved.diagonal() - parameters)

    fit = least_squares(off, start, slopes, method='lm', x_scale='jac', ftol=1e-4)
    if not fit.success:
        return UNKNOWN, UNKNOWN
    # What is round has no angle, of which nothing is asked.
    variance = 2 * fit.cost / (len(cells) - len(start)) * np.square(np.linalg.pinv(fit.jac))
    axes = [
        Estimate(2 / size, math.hypot(2 * math.sqrt(variance[k].sum()) / size**2, of.uncertainty))
        for k, of in ((2, sizes.length), (3, sizes.width))
        if (size := abs(float(fit.x[k])))
    ]
    first, second = sorted(axes, key=lambda each: -each.value)
    return first, second
