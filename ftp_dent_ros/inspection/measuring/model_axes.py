"""The axes of the dent function that lies closest to a dent."""

from __future__ import annotations

import math

import numpy as np

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.inspection.measuring.outlines.dent_model import fit_dent
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.sizes import Mask, Sizes

# Cells along the longer side of a patch that the function is fitted to, at most: for speed.
_CELLS = 22
# Eq. 18 at 10 % of its depth, as a part of its axes.
_OF_AXES = 0.835


def model_axes(
    sizes: Sizes, patch: Patch, region: Mask | None, correlated_area: float
) -> tuple[Estimate, Estimate]:
    """Full axes of the dent function (eq. 18) that lies closest to the patch, the longer first.

    Neighbours are left out. Not measured where the patch does not determine the function.
    """
    every = math.ceil(max(patch.depth.shape) / _CELLS)
    thin = slice(None, None, every), slice(None, None, every)
    known = patch.known if region is None else patch.known & region
    x, y = np.meshgrid(patch.x[thin[1]], patch.y[thin[0]])
    half = [math.log(each.value / 2 / _OF_AXES) for each in (sizes.length, sizes.width)]
    start = np.array([*sizes.outline.centre, *half, sizes.angle, sizes.depth.value])
    cells = correlated_area / (every * patch.step) ** 2
    model = fit_dent(x, y, patch.depth[thin], known[thin], start, cells)
    if not model.is_determined:
        return Estimate(math.nan, math.nan), Estimate(math.nan, math.nan)
    (length, width), (length_error, width_error) = model.axes, model.axes_uncertainty
    return (
        Estimate(length, math.hypot(length_error, sizes.length.uncertainty)),
        Estimate(width, math.hypot(width_error, sizes.width.uncertainty)),
    )
