"""From a cloud's own grid, which is its camera's, to a regular one over its tangent plane."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Of the way back, a polynomial, and of the corrections that make it exact.
_DEGREE, _CORRECTIONS = 3, 2

Grid = NDArray[np.float32]


def way_back(place: NDArray[np.float64], pixel: NDArray[np.float64]) -> Any:
    """From x and y to the cloud's column and row, nearly: a function of a grid's x and y.

    Parameters
    ----------
    place : ndarray, shape (n, 2)
        x and y of some points, metres.
    pixel : ndarray, shape (n, 2)
        Their columns and rows in the cloud.
    """
    scale = np.abs(place).max()
    powers = [_powers(place[:, axis] / scale) for axis in (0, 1)]
    terms = np.einsum('ni,nj->nij', *powers).reshape(len(place), -1)
    weights, *_ = np.linalg.lstsq(terms, pixel, rcond=None)
    weights = weights.reshape(_DEGREE + 1, _DEGREE + 1, 2)

    def back(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        along_x, along_y = _powers(x / scale), _powers(y / scale)
        return np.stack([along_y @ weights[..., axis].T @ along_x.T for axis in (0, 1)], axis=-1)

    return back


def cells(local: Grid, low: NDArray, size: float, count: NDArray, back: Any) -> tuple[Grid, Grid]:
    """Columns and rows of the cloud's grid at which the cells' x and y are.

    Parameters
    ----------
    local : ndarray, shape (height, width, 3), float32
        The cloud in the plane's frame, metres; NaN where there is no point.
    low : ndarray, shape (2,)
        x and y of the first cell, metres.
    size : float
        Of a cell, metres.
    count : ndarray, shape (2,)
        Cells along x and y.
    back : callable
        As `way_back` gives it.
    """
    x, y = (low[axis] + size * np.arange(count[axis]) for axis in (0, 1))
    pixel = back(x, y)
    # How the cloud's column and row change with x and y: that of the polynomial is near enough.
    along_y, along_x = np.gradient(pixel, size, axis=(0, 1))
    u, v = pixel[..., 0].astype(np.float32), pixel[..., 1].astype(np.float32)
    wanted_x, wanted_y = (each.astype(np.float32) for each in np.meshgrid(x, y))
    places = np.ascontiguousarray(local[..., :2])
    slopes = [each.astype(np.float32) for each in (along_x, along_y)]
    for _ in range(_CORRECTIONS):
        here = remap(places, u, v)
        off_x, off_y = wanted_x - here[..., 0], wanted_y - here[..., 1]
        u = u + slopes[0][..., 0] * off_x + slopes[1][..., 0] * off_y
        v = v + slopes[0][..., 1] * off_x + slopes[1][..., 1] * off_y
    return u, v


def remap(field: Grid, u: Grid, v: Grid) -> Grid:
    """Values of a field at columns `u` and rows `v`, linearly; NaN beyond it."""
    result: Any = cv2.remap(
        field.astype(np.float32, copy=False),
        np.nan_to_num(u, nan=-9.0),
        np.nan_to_num(v, nan=-9.0),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(np.nan,) * 4,
    )
    return result


def _powers(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Powers up to the degree, shape (n, degree + 1)."""
    return values[:, None] ** np.arange(_DEGREE + 1)
