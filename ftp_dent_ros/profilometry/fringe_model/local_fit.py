"""Weighted least squares of light in windows: level, amplitude, and shift of the fringes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid

# Smallest determinant of a window's normal equations: the fringes' power squared, a millionth.
_SINGULAR = 1e-6


@dataclass(frozen=True, eq=False)
class LocalFit:
    """I = level + amplitude F + slope F' in the window about each node (eq. 3).

    Attributes
    ----------
    level, amplitude, slope : ndarray, shape (rows, nodes), float32
    weight : ndarray
        Mean weight of the window's bins; small where little light is usable.
    rest, total : ndarray
        Weighted mean square of what the fit leaves, and of the light about its mean.
    """

    level: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    slope: NDArray[np.float32]
    weight: NDArray[np.float32]
    rest: NDArray[np.float32]
    total: NDArray[np.float32]


def fit_windows(
    grid: BinGrid,
    light: NDArray[np.float32],
    waveform: NDArray[np.float32],
    derivative: NDArray[np.float32],
    weight: NDArray[np.float32],
) -> LocalFit:
    """Fit bins of light by a waveform and its derivative, window by window."""
    by_waveform, by_slope = weight * waveform, weight * derivative
    count, f, d, i, ff, fd, dd, fi, di, ii = (
        grid.window_sums(each)
        for each in (
            *(weight, by_waveform, by_slope, weight * light),
            *(by_waveform * waveform, by_waveform * derivative, by_slope * derivative),
            *(by_waveform * light, by_slope * light, weight * light * light),
        )
    )
    mean = 1 / np.maximum(count, np.float32(1e-6))
    ff, fd, dd = ff - f * f * mean, fd - f * d * mean, dd - d * d * mean
    fi, di, ii = fi - f * i * mean, di - d * i * mean, ii - i * i * mean
    scale = 1 / np.maximum(ff * dd - fd * fd, np.float32(_SINGULAR))
    amplitude, slope = (fi * dd - di * fd) * scale, (di * ff - fi * fd) * scale
    rest = np.maximum(ii - amplitude * fi - slope * di, 0) * mean
    return LocalFit(
        (i - amplitude * f - slope * d) * mean, amplitude, slope, count, rest, ii * mean
    )
