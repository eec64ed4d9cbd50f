"""Robust statistics: the median, spreads by it, and the weights of robust least squares."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Standard deviation of a normal distribution over its median absolute deviation: 1 over its upper
# quartile.
NORMAL_SPREAD = 1.4826
#: Fits of robust least squares, each with the weights of what the last one left.
FITS = 5
# Residual that counts a quarter then, standard deviations: of a hundred normal ones, all count.
_QUARTER = 4.0


def median(values: NDArray[np.number]) -> float:
    """Median of finite values, of any shape; NaN of none.

    NumPy's takes several times as long over its checks.
    """
    half = values.size // 2
    if not values.size:
        return math.nan
    parted = np.partition(values.ravel(), half)
    high = parted[half]
    return float(high if values.size % 2 else (parted[:half].max() + high) / 2)


def deviation(residuals: NDArray[np.floating]) -> float:
    """Standard deviation about zero of normal residuals, by their median size; NaN of none."""
    return float(NORMAL_SPREAD * median(np.abs(residuals)))


def cauchy(residual: NDArray[np.float64], half: float) -> NDArray[np.float64]:
    """Cauchy's weight of least squares, which is a half at the residual `half`."""
    return 1 / (1 + np.square(residual / half))


def geman_mcclure(
    square: NDArray[np.float64], quarter: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Geman and McClure's weight of least squares, a quarter at the squared residual `quarter`."""
    return 1 / np.square(1 + square / quarter)


def redescending(residuals: NDArray[np.floating]) -> NDArray[np.float64]:
    """Geman and McClure's weights of least squares by what the last fit left."""
    quarter = max(_QUARTER * deviation(residuals), np.finfo(float).eps)
    return geman_mcclure(np.square(residuals.astype(float)), quarter**2)


def fitted(terms: NDArray[np.floating], values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Coefficients of terms, shape (unknowns, n), that robust least squares give for values."""
    weighted = terms
    for _ in range(FITS):
        found = np.linalg.lstsq(weighted @ terms.T, weighted @ values, rcond=None)[0]
        weighted = terms * redescending(values - found @ terms)
    return found
