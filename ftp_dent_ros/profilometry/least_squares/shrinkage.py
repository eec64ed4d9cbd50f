"""Noise taken off flat skin, dents left alone: shrinkage in bands of scale.

The field is split into bands from fine to coarse. Each band is held back where its energy is no
more than its noise explains (Wiener's gain); what a coarser band has found is evidence that the
finer one holds the details of it, so that energy is handed down from coarse to fine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.windows import Windows

# Standard deviations of the bands' edges, in those of the windows.
_SCALES = (1.0, 2.0, 4.0, 8.0)
_MEDIAN_OF_SQUARE = 0.4549


@dataclass(frozen=True)
class Shrunk:
    """A field less its noise.

    Attributes
    ----------
    values : ndarray, shape (rows, columns), float32
    variance : ndarray, shape (rows, columns), float32
        Of what is left of the noise.
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    scale: float
    gains: list


def band_shares(power: int) -> list[float]:
    """Variance of white noise in each band, and below them all, for noise that the windows
    ``1 - (1 - G)^power`` have let through with variance 1."""
    f = np.linspace(0, 1.5, 3001)[1:]  # of isotropic frequencies, in 1 / sigma
    passed = np.square(1 - (1 - np.exp(-2 * (np.pi * f) ** 2)) ** power) * f
    edges = [np.ones_like(f)] + [np.exp(-2 * (np.pi * f * scale) ** 2) for scale in _SCALES]
    shares = [
        (passed * np.square(upper - lower)).sum()
        for upper, lower in zip(edges[:-1], edges[1:], strict=True)
    ]
    return [float(share / passed.sum()) for share in (*shares, (passed * edges[-1] ** 2).sum())]


def smoothed(values, windows: Windows, scale: float):
    """Gaussian of `scale` windows, the wide ones on a coarser grid."""
    step = 1
    while scale * min(windows.sigma_u, windows.sigma_v) / (2 * step) > 2.0 and step < 4:
        step *= 2
    if step == 1:
        return cv2.GaussianBlur(
            values, (0, 0), sigmaX=scale * windows.sigma_u, sigmaY=scale * windows.sigma_v,
            borderType=cv2.BORDER_REPLICATE,
        )
    rows, columns = values.shape
    small = cv2.resize(
        values, (-(-columns // step), -(-rows // step)), interpolation=cv2.INTER_AREA
    )
    lost = (step * step - 1) / 12 + 0.16 * step * step
    su, sv = (math.sqrt(max((scale * s) ** 2 - lost, 0.25)) / step for s in (windows.sigma_u, windows.sigma_v))
    small = cv2.GaussianBlur(small, (0, 0), sigmaX=su, sigmaY=sv, borderType=cv2.BORDER_REPLICATE)
    return cv2.resize(small, (columns, rows), interpolation=cv2.INTER_LINEAR)


def shrink(values, variance, inside, windows: Windows, power: int, o=None) -> Shrunk:
    """Shrink a field.

    Parameters
    ----------
    values : ndarray, shape (rows, columns), float32
        Continued beyond the region.
    variance : ndarray, shape (rows, columns), float32
        Predicted variance of its noise, but for a common factor.
    inside : ndarray, shape (rows, columns), bool
    """
    o = o or {}
    lam, rho, ew = o.get('lam', 1.5), o.get('rho', .25), o.get('ew', 1.5)
    shares = band_shares(power)
    levels = [values] + [smoothed(values, windows, s) for s in _SCALES]
    bands = [a - b for a, b in zip(levels[:-1], levels[1:], strict=True)]
    finest = np.square(bands[0][inside]) / variance[inside]
    factor = float(np.median(finest)) / _MEDIAN_OF_SQUARE / shares[0]
    noise = factor * variance
    result, left = levels[-1].copy(), shares[-1] * noise
    signal = np.zeros_like(values)
    gains = []
    ins = inside.astype(np.float32)
    for k in range(len(bands) - 1, -1, -1):
        energy = smoothed(bands[k] ** 2, windows, ew * _SCALES[k])
        here = shares[k] * noise
        signal = np.maximum(energy - lam * here, rho * signal)
        gain = signal / np.maximum(signal + here, 1e-30)
        result += gain * bands[k]
        left = left + gain * here
        gains.append(gain)
    return Shrunk(result, left, math.sqrt(factor), gains)
