"""Which parts of a lattice are one panel, beyond what was not measured between them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.contour_fit import first_contour
from ftp_dent_ros.inspection.measuring.skin.gaps import GAP, gaps_of
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import median_of

# Parts that are compared, the largest first, and cells of one that a contour is fitted to, about.
_MOST, _FITTED = 8, 4000
# Two parts are one panel if about one contour they stray no more than so many times as about their
# own, and do not stand apart within `_BESIDE` smallest widths of what parts them by more than so
# many smallest depths.
_STRAY, _APART, _BESIDE = 1.25, 0.5, 3.0
# Islands within a panel's gaps are its own where they lie no deeper than this slope to it.
_SLOPE = 0.5

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]


def joined(
    regions: list[Mask],
    lattice: Lattice,
    viewpoint: NDArray[np.float64],
    settings: SmallestDent,
    rng: np.random.Generator,
) -> list[Mask]:
    """The regions, those that go on beyond what was not measured as one."""
    whole: list[Mask] = []
    for region in regions[:_MOST]:
        for index, other in enumerate(whole):
            if _is_one(region, other, lattice, viewpoint, settings, rng):
                whole[index] = other | region
                break
        else:
            whole.append(region)
    return whole


def _is_one(one, other, lattice, viewpoint, settings, rng) -> bool:
    """Whether one contour explains two regions as well as one each does."""
    both, tolerance = one | other, settings.smallest_depth / 10
    together = depths_of(_first(both, lattice, viewpoint, tolerance, rng), lattice, both)
    for part in (one, other):
        alone = depths_of(_first(part, lattice, viewpoint, tolerance, rng), lattice, part)
        strays = median_of(np.abs(together[part]))
        if strays > max(_STRAY * median_of(np.abs(alone[part])), tolerance):
            return False
    reach = _BESIDE * settings.smallest_width / max(lattice.spacing)
    sides = [
        part & (_distance(beyond) < reach + _between(one, other))
        for part, beyond in ((one, other), (other, one))
    ]
    levels = [median_of(together[side]) for side in sides]
    return abs(levels[0] - levels[1]) < _APART * settings.smallest_depth


def _between(one: Mask, other: Mask) -> float:
    """Cells from one region to the nearest of another."""
    return float(_distance(one)[other].min())


def _distance(mask: Mask) -> Map:
    """Of each cell to the nearest of a mask, cells."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3))


def _first(region, lattice, viewpoint, noise, rng) -> Contour:
    cells = np.flatnonzero(region)
    points = lattice.points.reshape(-1, 3)[cells[:: 1 + len(cells) // _FITTED]]
    return first_contour(points, viewpoint, noise, rng)


def islands(
    lattice: Lattice,
    left: Mask,
    mask: Mask,
    contour: Contour,
    tolerance: float,
    settings: SmallestDent,
) -> Mask:
    """Cells left over that lie within a panel's gaps, near enough to its contour."""
    if not left.any():
        return left
    reach = round(GAP * settings.smallest_width / max(lattice.spacing))
    within = left & gaps_of(mask, reach)
    if not within.any():
        return within
    height = np.abs(depths_of(contour, lattice, within))
    return within & (height < tolerance + _SLOPE * max(lattice.spacing) * _distance(mask))


def depths_of(contour: Contour, lattice: Lattice, part: Mask) -> Map:
    """Depths of cells below a contour, metres; 0 beside the part."""
    return np.where(part, contour.depth(lattice.points), np.float32(0))
