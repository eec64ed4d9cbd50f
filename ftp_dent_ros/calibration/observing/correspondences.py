"""The projector coordinates of a board's corners, from those of the pixels around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.observing.decoding import Codes
from ftp_dent_ros.robust import NORMAL_SPREAD

# A window reaches this part of the way to the nearest corner. Beyond it a quadratic no longer
# follows the perspective of a tilted board.
_REACH = 0.9
# Fewer pixels than this do not hold down the six coefficients.
_FEWEST = 40
# A pixel this many robust deviations off the fit has a wrong code.
_OUTLYING = 4.0
_ROUNDS = 4
# More pixels than about this many along a window's side tell nothing more.
_SIDE = 49


def corner_coordinates(
    codes: Codes, corners: NDArray[np.float64], spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Projector pixels (u, v) at corners of shape (n, 2), and how they scatter about the fit.

    Both have the corners' shape, and NaN where nothing is known.

    About each corner a quadratic in the camera's pixels is fitted to the projector's coordinates
    (the local homographies of Moreno and Taubin, 3DIMPVT 2012, to second order), and read at the
    corner. White and black squares lie symmetrically about it, so that what blur does to the phase
    at their edges cancels.
    """
    radius = max(3, int(_REACH * spacing))
    step = max(1, round(2 * radius / _SIDE))
    result, scatter = np.full((2, *corners.shape), np.nan)
    for index, corner in enumerate(corners):
        if not np.isfinite(corner).all():
            continue
        column, row = np.rint(corner).astype(int)
        rows = slice(max(row - radius, 0), row + radius + 1, step)
        columns = slice(max(column - radius, 0), column + radius + 1, step)
        for axis, values in enumerate((codes.u, codes.v)):
            centre = (corner - [columns.start, rows.start]) / step
            result[index, axis], scatter[index, axis] = _at(
                values[rows, columns], centre, radius / step
            )
    return result, scatter


def _at(values: NDArray, centre: NDArray, radius: float) -> tuple[float, float]:
    """Value of a robust quadratic fit to a window, at a point of it, and the median residual."""
    rows, columns = np.nonzero(np.isfinite(values))
    if len(rows) < _FEWEST:
        return np.nan, np.nan
    x, y = (columns - centre[0]) / radius, (rows - centre[1]) / radius
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    value = values[rows, columns].astype(float)
    # A first guess that half of the pixels may spoil: about the median.
    kept = np.abs(value - np.median(value)) <= 3 * np.median(np.abs(value - np.median(value))) + 1
    coefficients, off = np.zeros(6), np.full(len(value), np.inf)
    for _ in range(_ROUNDS):
        if kept.sum() < _FEWEST:
            return np.nan, np.nan
        coefficients, *_ = np.linalg.lstsq(basis[kept], value[kept], rcond=None)
        off = np.abs(basis @ coefficients - value)
        kept = off <= _OUTLYING * NORMAL_SPREAD * np.median(off[kept]) + 1e-3
    scatter = float(np.median(off))
    return (float(coefficients[0]) if kept.mean() > 0.5 else np.nan), scatter
