"""Points spread over a pixel's area and over an exposure, and fields there."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Generators of a rank-1 lattice over (column, row, time): evenly spread in each of them alone
# and in the sums of them along which moving fringes run.
_LATTICE = (1, 19, 53)

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]


def moved(place: Image, slopes: list[Image], point: NDArray) -> tuple[Image, Image]:
    """Two fields, shape (2, h, w), float32, at a point of the pixels and the exposure."""
    first, second = (
        shifted(field, [slope[index] for slope in slopes], point)
        for index, field in enumerate(place)
    )
    return first, second


def shifted(field: Image, slopes: list[Image], point: NDArray) -> Image:
    """A field of shape (h, w), float32, at a point of the pixels and the exposure."""
    for axis in np.flatnonzero(point):
        field = cv2.scaleAdd(slopes[axis], point[axis], field)
    return field


def cubature(dimensions: int, intervals: int) -> NDArray[np.float64]:
    """Points (column, row[, time]) from -1/2 to 1/2 whose mean integrates cubic polynomials.

    On each axis two points, so far out that the variance is right; time in a few intervals.
    """
    star = math.sqrt(dimensions / 12) * np.vstack([np.eye(dimensions), -np.eye(dimensions)])
    if dimensions < 3:
        return star
    star[:, 2] /= intervals
    centres = np.zeros((intervals, 1, 3))
    centres[:, 0, 2] = (np.arange(intervals) + 0.5) / intervals - 0.5
    return (centres + star).reshape(-1, 3)


def lattice(count: int) -> NDArray[np.float64]:
    """Points (column, row, time) from -1/2 to 1/2, symmetric about 0, shape (count, 3)."""
    odd = 2 * np.arange(count) + 1
    return (np.outer(odd, _LATTICE) % (2 * count)) / (2 * count) - 0.5
