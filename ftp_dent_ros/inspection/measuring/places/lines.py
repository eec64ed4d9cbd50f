"""Narrow valleys, seen by what all places along them tell together.

A crease or a groove that is narrower than the cloud resolves is shallow in it, and the cloud is in
doubt of its steep flanks: no single place departs from the skin beyond that doubt. What paint and
noise feign goes to and fro from fringe to fringe, a valley goes on: a matched filter along each
direction asks all of it at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.evidence import SIGNIFICANT
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.noise import median_of

# Cells of a coarser grid, in scales of the smoothing that it is laid on.
_CELL = 1.5
# Of the Gaussians along a valley, standard deviations in smallest widths: of what is three and
# six times as long.
_ALONG = (0.7, 1.4)
# Directions of either, that miss no valley by more than its width.
_DIRECTIONS = 8, 16
# How far a kernel reaches, standard deviations, and how much of it must be known.
_REACH, _KNOWN = 2.0, 0.7
# Of a valley's mean that may be left in one over a smallest width: else it is none.
_BESIDE = 0.6
# Part of that mean from which on a cell is the valley's.
_PART = 0.5

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]


def valleys(
    skin: BareSkin, panel: Mask, seeds: Mask, lattice: Lattice, width: float, floor: float
) -> Mask:
    """Cells of narrow valleys that are significant along their length.

    Parameters
    ----------
    skin : BareSkin
    panel, seeds : ndarray, shape (rows, columns), bool
        Cells to look at, and those of which a valley has a smallest width in a row at least.
    lattice : Lattice
    width : float
        Of the smallest dent, metres.
    floor : float
        Metres; what departs less is not looked at.
    """
    found = np.zeros_like(panel)
    seeds = _long(seeds, lattice.cells(width))
    if not seeds.any():
        return found
    # What all of the skin has alike is noise as it is everywhere.
    usual = median_of(skin.noise.extra[panel])
    reach = [math.ceil(_REACH * max(_ALONG) * each) for each in lattice.cells(width)]
    for window in _around(seeds, reach):
        found[window] |= _within(skin, panel, window, lattice, width, floor, usual)
    return found


def _long(seeds: Mask, cells: tuple[float, float]) -> Mask:
    """Those parts that are as long as the smallest width: fittings are shorter."""
    if not seeds.any():
        return seeds
    _, labels, stats, _ = cv2.connectedComponentsWithStats(seeds.view(np.uint8))
    columns, rows = stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]
    chosen = np.hypot(columns / cells[0], rows / cells[1]) > 1
    chosen[0] = False
    return np.asarray(chosen[labels])


def _around(seeds: Mask, reach: list[int]) -> Iterator[tuple[slice, slice]]:
    """Windows that hold all seeds and what a kernel reaches of them."""
    near = cv2.dilate(seeds.view(np.uint8), np.ones((reach[1] + 1, reach[0] + 1), np.uint8))
    _, _, stats, _ = cv2.connectedComponentsWithStats(near)
    for left, top, columns, rows, _ in stats[1:]:
        yield (
            slice(max(top - reach[1] // 2, 0), top + rows + reach[1] // 2),
            slice(max(left - reach[0] // 2, 0), left + columns + reach[0] // 2),
        )


def _within(
    skin: BareSkin,
    panel: Mask,
    window: tuple[slice, slice],
    lattice: Lattice,
    width: float,
    floor: float,
    usual: float,
) -> Mask:
    noise, fine, wide = skin.noise, skin.maps[0][window], skin.maps[-1][window]
    scale = float(noise.scales[1])
    known = panel[window] & np.isfinite(fine)
    rows, columns = known.shape
    size = tuple(
        max(1, round(count * each / (_CELL * scale)))
        for count, each in zip((columns, rows), lattice.spacing, strict=True)
    )
    cell = columns * lattice.spacing[0] / size[0], rows * lattice.spacing[1] / size[1]
    images = (
        known.astype(np.float32),
        np.where(known, fine, np.float32(0)),
        np.where(known, np.square(noise.extra[window]), np.float32(0)),
    )
    coarse = [cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in images]
    best = np.zeros(size[::-1], np.float32)
    for part, directions in zip(_ALONG, _DIRECTIONS, strict=True):
        along = part * width
        places = math.sqrt(1 + (along / noise.reach) ** 2)
        alike = places * math.sqrt(1 + (scale / noise.reach) ** 2)
        common = noise.where(0.0, math.sqrt(scale * along))
        least = max(SIGNIFICANT * math.hypot(common, usual / math.sqrt(alike)), 2 * floor)
        sure = skin.along(places)
        for angle in np.arange(directions) * math.pi / directions:
            kernel = _kernel(along, scale, float(angle), cell)
            share, depth, square = (_filtered(each, kernel) for each in coarse)
            weight = np.maximum(share, np.float32(_KNOWN))
            unsure = np.sqrt(square / weight / np.float32(alike) + np.float32(common**2))
            mean = depth / weight
            found = (share > _KNOWN) & (mean > np.maximum(np.float32(sure) * unsure, least))
            np.maximum(best, mean, out=best, where=found)
    if not best.any():
        return np.zeros_like(known)
    # Cells beside those whose kernel lies on the valley are its own too.
    best = cv2.dilate(best, np.ones((3, 3), np.uint8))
    mean = cv2.resize(best, (columns, rows), interpolation=cv2.INTER_NEAREST)
    with np.errstate(invalid='ignore'):
        return known & (mean > 0) & (fine > _PART * mean) & (wide < _BESIDE * mean)


def _kernel(along: float, across: float, angle: float, cell: tuple[float, float]) -> Map:
    """Gaussian that is longer than wide, of sum 1."""
    half = [math.ceil(_REACH * along / each) for each in cell]
    x, y = np.meshgrid(
        np.arange(-half[0], half[0] + 1) * cell[0], np.arange(-half[1], half[1] + 1) * cell[1]
    )
    c, s = math.cos(angle), math.sin(angle)
    u, v = (c * x + s * y) / along, (c * y - s * x) / across
    kernel = np.exp(-(u * u + v * v) / 2)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _filtered(values: Any, kernel: Map) -> Any:
    return cv2.filter2D(values, -1, kernel, borderType=cv2.BORDER_CONSTANT)
