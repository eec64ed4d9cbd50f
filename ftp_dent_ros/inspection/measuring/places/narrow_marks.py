"""Narrow light marks in the image of the skin: where a tool may have taken paint and material."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.places.kinds import LONG
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Half the side of the square whose median is the skin beside a mark, metres.
_BESIDE = 0.01
# A mark is lighter than that by this part at its lightest and by so many of its usual strays
# (1.4826 times the median absolute deviation), and by half of that all over. The fringes leave
# 3 %.
_LIGHTER, _STRAYS, _ALL_OVER = 0.05, 4.0, 0.5
# Widest, metres.
_WIDEST = 0.008
# The breadth that a mark's cells scatter over, by the one that their number gives: of a bar 1, of
# a ring, a corner or letters much more.
_STRAIGHT = 1.5
# Of that square that has points, at least; and points across it that tell its median.
_MEASURED, _COARSE = 0.8, 11
# Every so many points are enough for the usual skin.
_SOME = 7

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class NarrowMark:
    """A straight light mark.

    Attributes
    ----------
    rows, columns : ndarray, shape (points,)
        Of its points in the cloud.
    length, width : float
        At half of its brightness, metres.
    middle, axis : ndarray, shape (3,)
        Relative to the lattice's origin, metres, and a unit vector along the length.
    crossed : float
        Columns of the cloud from one end to the other.
    is_on_even_skin : bool
        Whether skin as it is around rarely is as light: dirt and streaks have marks of their own.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    length: float
    width: float
    middle: NDArray[np.float64]
    axis: NDArray[np.float64]
    crossed: float
    is_on_even_skin: bool


def narrow_marks(skin: NDArray[np.uint8], lattice: Lattice, shortest: float) -> list[NarrowMark]:
    """Marks that are narrow, straight and lighter than the skin on both sides.

    Parameters
    ----------
    skin : ndarray, shape (rows of the cloud, columns of the cloud), uint8
        The light without the fringes, 0 where there is no point.
    lattice : Lattice
    shortest : float
        Length of the shortest mark, metres.
    """
    known = lattice.measured & (skin > 0)
    across, down = (each / lattice.block for each in lattice.spacing)
    usual, share = _beside(skin, known, 2 * _BESIDE / (across + down))
    known &= (share > _MEASURED) & (usual > 0)
    if not known.any():
        return []
    lighter = np.where(known, skin / np.maximum(usual, 1) - 1, np.float32(0))
    some = lighter.ravel()[np.flatnonzero(known)[::_SOME]]
    strays = _STRAYS * NORMAL_SPREAD * median(np.abs(some))
    least = max(_LIGHTER, strays)
    above = (lighter > _ALL_OVER * least).astype(np.uint8)
    free, taken, done = 1, 2, 3
    found = []
    for row, column in np.argwhere(lighter > least).tolist():
        if above[row, column] != free:
            continue
        # What is connected with one that is light enough: few are, of all that are above.
        _, _, _, (left, top, columns, rows) = cv2.floodFill(
            above, None, (column, row), taken, flags=8
        )
        window = slice(top, top + rows), slice(left, left + columns)
        part = above[window] == taken
        above[window][part] = done
        if math.hypot(columns * across, rows * down) < shortest:
            continue
        bright = part & (lighter[window] > _ALL_OVER * _brightness(lighter[window][part]))
        at = np.nonzero(bright)
        mark = _bar(at[0] + top, at[1] + left, lattice, strays < _LIGHTER)
        if mark is not None and mark.length > shortest:
            found.append(mark)
    return found


def _beside(
    skin: NDArray[np.uint8], known: Mask, reach: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Median within squares of 2 `reach` points, and which share of them is known."""
    coarse = max(1, round(2 * reach / _COARSE))
    size = max(1, skin.shape[1] // coarse), max(1, skin.shape[0] // coarse)
    side = 2 * round(reach / coarse) + 1
    few = cv2.medianBlur(cv2.resize(skin, size, interpolation=cv2.INTER_AREA), side)
    share = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    share = cv2.boxFilter(share, -1, (side, side))
    whole = skin.shape[::-1]
    return (
        np.asarray(cv2.resize(few.astype(np.float32), whole)),
        np.asarray(cv2.resize(share, whole)),
    )


def _brightness(values: NDArray[np.float32]) -> float:
    """Of a mark, but for its brightest points."""
    return float(np.percentile(values, 80))


def _bar(
    rows: NDArray[np.intp], columns: NDArray[np.intp], lattice: Lattice, is_even: bool
) -> NarrowMark | None:
    """The bar that some points make, if they do."""
    if len(rows) < 5:
        return None
    across, down = (each / lattice.block for each in lattice.spacing)
    points = lattice.all_points[rows, columns].astype(float)
    middle = points.mean(axis=0)
    squares, axes = np.linalg.eigh(np.cov((points - middle).T))
    broad = math.sqrt(12 * max(squares[1], 0.0))
    place = (points - middle) @ axes[:, 2]
    long = float(np.ptp(np.percentile(place, [1, 99]))) / 0.98
    width = len(rows) * across * down / max(long, across)
    if width > _WIDEST or long < LONG * width or broad > _STRAIGHT * width:
        return None
    crossed = long * abs(float(place @ columns) / float(place @ place))
    return NarrowMark(rows, columns, long, float(width), middle, axes[:, 2], crossed, is_even)
