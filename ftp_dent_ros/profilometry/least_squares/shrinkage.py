"""Noise taken off flat skin, dents left alone: shrinkage in bands of scale.

The field is split into bands from fine to coarse. Each band is held back where its energy is no
more than its noise explains (Wiener's gain); what a coarser band has found is evidence that the
finer one holds the details of it, so that energy is handed down from coarse to fine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.windows import Windows

# Standard deviations of the bands' edges, in those of the windows.
_SCALES = (1.0, 2.0, 4.0, 8.0)
# Energy is a mean over so many times the width of a band's coarser edge; what exceeds so many
# times the noise is signal; and so much of the signal is expected in the next finer band.
_NEIGHBOURHOOD = 1.5
_NOISE = 2.0
_HANDED_DOWN = 0.03
_MEDIAN_OF_SQUARE = 0.4549


@dataclass(frozen=True)
class Shrunk:
    """A field less its noise.

    Attributes
    ----------
    values : ndarray, shape (rows, columns), float32
    variance : ndarray, shape (rows, columns), float32
        Of what is left of the noise, and of what was taken off with it.
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]


def shrink(
    values: NDArray[np.float32],
    variance: NDArray[np.float32],
    inside: NDArray[np.bool_],
    windows: Windows,
    power: int,
) -> Shrunk:
    """Shrink a field.

    Parameters
    ----------
    values : ndarray, shape (rows, columns), float32
        Continued beyond the region.
    variance : ndarray, shape (rows, columns), float32
        Of its noise, but for a common factor, which the finest band tells.
    inside : ndarray, shape (rows, columns), bool
        The region.
    windows : Windows
    power : int
        Windows that the noise has come through, see `band_shares`.
    """
    levels = [values, *(windows.wide(values, scale) for scale in _SCALES)]
    bands = [finer - coarser for finer, coarser in zip(levels[:-1], levels[1:], strict=True)]
    *shares, rest = band_shares(power)
    finest = np.square(bands[0][inside]) / variance[inside]
    factor = float(np.median(finest)) / _MEDIAN_OF_SQUARE / shares[0]
    noise = np.maximum(np.float32(factor) * variance, np.float32(1e-12))
    result = levels[-1].copy()
    left = np.float32(rest) * noise
    signal = np.zeros_like(values)
    for band, share, scale in reversed(list(zip(bands, shares, _SCALES, strict=True))):
        energy = windows.wide(band * band, _NEIGHBOURHOOD * scale)
        here = np.float32(share) * noise
        signal = np.maximum(energy - np.float32(_NOISE) * here, np.float32(_HANDED_DOWN) * signal)
        gain = signal / (signal + here)
        result += gain * band
        left += gain * here
    return Shrunk(result, left)


@lru_cache(maxsize=8)
def band_shares(power: int) -> tuple[float, ...]:
    """Share of each band, and of what lies below them, in the variance of white noise.

    Parameters
    ----------
    power : int
        The noise has come through windows ``1 - (1 - G)^power``: 1 for a Gaussian, 2 for a
        flat-top.
    """
    frequency = np.linspace(0, 1.5, 3001)  # radial, in 1 / sigma of the windows

    def gaussian(scale: float) -> NDArray[np.float64]:
        return np.exp(-2 * (math.pi * scale * frequency) ** 2)

    weight = frequency * np.square(1 - (1 - gaussian(1)) ** power)
    edges = [np.ones_like(frequency), *(gaussian(scale) for scale in _SCALES)]
    pieces = [finer - coarser for finer, coarser in zip(edges[:-1], edges[1:], strict=True)]
    shares = [weight @ np.square(piece) for piece in (*pieces, edges[-1])]
    return tuple(float(share / weight.sum()) for share in shares)
