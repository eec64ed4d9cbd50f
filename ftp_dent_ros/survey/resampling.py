"""From a cloud's own grid, which is its camera's, to a regular one over its tangent plane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Of polynomials; and corrections that make a way back exact.
_DEGREE, _CORRECTIONS = 3, 2

Grid = NDArray[np.float32]
Array = NDArray[np.float64]


def polynomial(
    place: NDArray[np.floating], values: NDArray[np.floating]
) -> Callable[[Array, Array], Array]:
    """Least squares through values at places: a function of a grid's x and y.

    Parameters
    ----------
    place : ndarray, shape (n, 2)
        x and y.
    values : ndarray, shape (n, m)

    Returns
    -------
    callable
        Of x, shape (columns,), and y, shape (rows,): values of shape (m, rows, columns).
    """
    low, high = place.min(axis=0), place.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-12)
    along_x, along_y = (_powers((place[:, k] - middle[k]) / half[k]) for k in (0, 1))
    terms = (along_y[:, :, None] * along_x[:, None, :]).reshape(len(place), -1)
    # Between -1 and 1 the normal equations are well enough conditioned, and quick.
    normal = terms.T @ terms + 1e-9 * len(place) * np.eye(terms.shape[1])
    weights = np.linalg.solve(normal, terms.T @ values).T
    weights = weights.reshape(-1, _DEGREE + 1, _DEGREE + 1)

    def at(x: Array, y: Array) -> Array:
        columns, rows = _powers((x - middle[0]) / half[0]), _powers((y - middle[1]) / half[1])
        result: Array = rows @ weights @ columns.T
        return result

    return at


def cells(
    places: Grid, low: NDArray, size: float, count: NDArray, back: Callable[[Array, Array], Array]
) -> tuple[Grid, Grid]:
    """Columns and rows of the cloud's grid at which the cells' x and y are.

    Parameters
    ----------
    places : ndarray, shape (height, width, 2), float32
        x and y of the cloud in the plane's frame, metres; NaN where there is no point.
    low : ndarray, shape (2,)
        x and y of the first cell, metres.
    size : float
        Of a cell, metres.
    count : ndarray, shape (2,)
        Cells along x and y.
    back : callable
        From x and y to column and row, nearly, as `polynomial` gives it.
    """
    x, y = (low[axis] + size * np.arange(count[axis]) for axis in (0, 1))
    u, v = back(x, y).astype(np.float32)
    # How column and row change with x and y: as in the middle is near enough.
    ends = [np.array([axis.mean() - size, axis.mean() + size]) for axis in (x, y)]
    middle = back(*ends)
    along_x, along_y = np.diff(middle.mean(axis=1)), np.diff(middle.mean(axis=2))
    slope = (np.hstack([along_x, along_y]) / (2 * size)).astype(np.float32)
    wanted_x, wanted_y = x.astype(np.float32), y.astype(np.float32)[:, None]
    for _ in range(_CORRECTIONS):
        here_x, here_y = cv2.split(remap(places, u, v))
        # Where there is no point the first guess stays.
        off_x, off_y = np.nan_to_num(wanted_x - here_x), np.nan_to_num(wanted_y - here_y)
        u = u + slope[0, 0] * off_x + slope[0, 1] * off_y
        v = v + slope[1, 0] * off_x + slope[1, 1] * off_y
    return u, v


def remap(field: Grid, u: Grid, v: Grid, how: int = cv2.INTER_LINEAR) -> Grid:
    """Values of a field at columns `u` and rows `v`, as OpenCV interpolates; NaN beyond it."""
    result: Any = cv2.remap(
        field.astype(np.float32, copy=False),
        np.where(u > -9, u, np.float32(-9)),
        np.where(v > -9, v, np.float32(-9)),
        how,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(np.nan,) * 4,
    )
    return result


def _powers(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Powers up to the degree, shape (n, degree + 1)."""
    return values[:, None] ** np.arange(_DEGREE + 1)
