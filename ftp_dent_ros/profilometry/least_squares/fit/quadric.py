"""A smooth surface through the first fit: a quadric in inverse depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Of the reweighting, by Tukey's biweight of 95 % efficiency for normal errors.
_ROUNDS = 6
_BISQUARE = 4.7


def basis(rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """1, x, y, x^2, xy, y^2 of rays of shape (..., 2), shape (..., 6)."""
    x, y = rays[..., 0], rays[..., 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def robust_quadric(
    rays: NDArray[np.float32], inverse_depth: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Coefficients of the quadric in 1 / z that most points lie on, shape (6,).

    Iteratively reweighted least squares with Tukey's bisquare: dents are outliers.

    Parameters
    ----------
    rays : ndarray, shape (points, 2)
    inverse_depth : ndarray, shape (points,)
    """
    values = inverse_depth.astype(float)
    scale = np.abs(rays).max(axis=0) + 1e-9
    terms = basis((rays / scale).astype(float))
    weight = np.ones(len(values))
    for _ in range(_ROUNDS):
        weighted = terms * weight[:, None]
        normal = weighted.T @ terms + 1e-9 * len(values) * np.eye(6)
        fitted = np.linalg.solve(normal, weighted.T @ values)
        misfit = values - terms @ fitted
        spread = NORMAL_SPREAD * median(np.abs(misfit)) + 1e-9
        weight = np.square(np.clip(1 - np.square(misfit / (_BISQUARE * spread)), 0, None))
    x, y = scale
    return fitted / [1, x, y, x * x, x * y, y * y]


def evaluate(coefficients: NDArray[np.float64], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """The quadric at rays of shape (rows, columns, 2)."""
    k = coefficients.astype(np.float32)
    x, y = rays[..., 0], rays[..., 1]
    return k[0] + x * (k[1] + k[3] * x + k[4] * y) + y * (k[2] + k[5] * y)
