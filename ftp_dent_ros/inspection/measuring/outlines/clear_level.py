"""The outline at a level that noise may drown: drawn where the depth stands out, carried on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.moments import NOISY
from ftp_dent_ros.inspection.measuring.outlines.outline import Outline, find_outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch

# Standard deviations of the noise that a level is above zero at least for an outline to be drawn
# there, and the part of the depth that such a level is at most.
_CLEAR, _HIGHEST = 2.0, 0.5

Mask = NDArray[np.bool_]


def clear_outline(
    patch: Patch,
    at: tuple[int, int],
    depth: float,
    wanted: float,
    region: Mask | None,
    noise: float,
) -> tuple[Outline, float, float] | None:
    """Outline at a part of the depth, the part it was drawn at, and how unsure that makes sizes.

    Where noise would draw it, it is drawn where the depth stands out and carried on by as much as
    the flanks of anything between a paraboloid and a Gaussian go on, which is a part of its sizes
    that they are unsure by; but for what is long, whose ends go on otherwise than its flanks.
    None if there is no outline.

    Parameters
    ----------
    patch : Patch
    at : (int, int)
        Row and column of the deepest cell.
    depth : float
        There, metres.
    wanted : float
        Part of the depth whose outline is asked for.
    region : ndarray, shape (rows, columns), bool, optional
        Cells that it lies within: where it ends there, nothing is carried on.
    noise : float
        Standard deviation of the depths, metres.
    """
    level = wanted
    if region is None:
        level = min(max(wanted, _CLEAR * noise / depth), _HIGHEST)
    outline = find_outline(patch, at, level * depth, region, noise)
    if outline is not None and level > wanted and _is_long(outline):
        level = wanted
        outline = find_outline(patch, at, level * depth, region, noise)
    if outline is None or outline.area <= 0:
        return None
    if level == wanted:
        return outline, level, 0.0
    least = math.sqrt((1 - wanted) / (1 - level))
    most = math.sqrt(math.log(wanted) / math.log(level))
    middle = (least + most) / 2
    # A range is its half over the root of three uncertain.
    return outline.carried_on(patch, middle), level, (most - least) / 2 / math.sqrt(3) / middle


def _is_long(outline: Outline) -> bool:
    length, angle, _ = outline.length()
    return length > NOISY * outline.width(angle)[0]
