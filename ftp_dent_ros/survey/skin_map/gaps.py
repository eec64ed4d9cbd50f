"""Skin that was not measured between skin that was."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

# A gap is no wider than this; a wider one is the rim of what was flown over; metres.
_WIDEST = 0.1


@dataclass(frozen=True, eq=False)
class Gap:
    """Cells that were not measured, side by side, between cells that were.

    Attributes
    ----------
    place : ndarray, shape (2,)
        Its middle, unrolled, metres.
    size : ndarray, shape (2,)
        Along x and y, metres.
    area : float
        Square metres.
    cells : ndarray, shape (n, 2), int
        Its cells: row and column.
    """

    place: NDArray[np.float64]
    size: NDArray[np.float64]
    area: float
    cells: NDArray[np.int64]


def find_gaps(measured: NDArray[np.bool_], low: NDArray[np.float64], side: float) -> list[Gap]:
    """What was not measured between what was, the largest first.

    Parameters
    ----------
    measured : ndarray, shape (rows, columns), bool
        Of the cells of the unrolled skin; x goes with columns.
    low : ndarray, shape (2,)
        x and y of the first cell's corner, metres.
    side : float
        Of a cell, metres.
    """
    seen = measured.astype(np.uint8)
    reach = int(np.ceil(_WIDEST / side / 2))
    wide = np.pad(seen, reach)
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, square)[reach:-reach, reach:-reach] > 0
    count, labels, boxes, middles = cv2.connectedComponentsWithStats(
        (closed & ~measured).astype(np.uint8), connectivity=4
    )
    gaps = []
    for label in range(1, count):
        left, top, width, height, cells = boxes[label]
        box = labels[top : top + height, left : left + width] == label
        places = np.argwhere(box) + np.array([top, left])
        # A corner that closing rounds off is no gap: nothing lies beyond it.
        if not _between(seen, places):
            continue
        place = low + side * (middles[label] + 0.5)
        size = side * np.array([width, height])
        gaps.append(Gap(place, size, float(cells * side**2), places))
    return sorted(gaps, key=lambda gap: -gap.area)


def _between(measured: NDArray[np.uint8], cells: NDArray[np.int64]) -> bool:
    """Whether a gap has measured cells on both sides of it, across where it is narrower.

    A notch in the rim has them too, but along itself.
    """
    row, column = cells.T
    lines = [len(np.unique(each)) for each in (column, row)]
    # As wide as long: both.
    across = [axis for axis in (0, 1) if lines[axis] >= max(lines)]
    return all(_enclosed(measured, row, column, axis) for axis in across)


def _enclosed(
    measured: NDArray[np.uint8], row: NDArray[np.int64], column: NDArray[np.int64], axis: int
) -> bool:
    """Whether most lines along an axis through some cells have measured ones at both ends."""
    at, along = (column, row) if axis == 0 else (row, column)
    lines = np.unique(at)
    hits = 0
    for line in lines:
        strip = measured[:, line] if axis == 0 else measured[line]
        low, high = along[at == line].min() - 1, along[at == line].max() + 1
        hits += low >= 0 and high < len(strip) and strip[low] and strip[high]
    return hits >= max(1, len(lines) // 2)
