"""Second moments of a set of cells, and the ellipse that has the same."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Variance of a place in a cell, in squares of its side.
_CELL = 1 / 12


def second_moments(
    columns: NDArray[np.intp], rows: NDArray[np.intp], across: float = 1.0, down: float = 1.0
) -> tuple[float, float, float]:
    """Variances along the columns and the rows, and covariance, of the places in some cells.

    Parameters
    ----------
    columns, rows : ndarray, shape (n,)
        Of the cells.
    across, down : float
        From cell to cell along columns and rows, in the unit that the moments are the square of.
    """
    x, y = columns - columns.mean(), rows - rows.mean()
    count = max(len(x) - 1, 1)
    return (
        across**2 * (float(x @ x) / count + _CELL),
        down**2 * (float(y @ y) / count + _CELL),
        across * down * float(x @ y) / count,
    )


def ellipse_axes(xx: float, yy: float, xy: float) -> tuple[float, float]:
    """Length and width of the ellipse with these second moments."""
    middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    return 4 * math.sqrt(middle + half), 4 * math.sqrt(max(middle - half, 0.0))
