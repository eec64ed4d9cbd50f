"""Noise taken off flat skin, dents left alone: shrinkage in bands of scale.

The field is split into bands from fine to coarse. Each band is held back where its energy is no
more than its noise explains (Wiener's gain); what a coarser band has found is evidence that the
finer one holds the details of it, so that energy is handed down from coarse to fine.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.median import median
from ftp_dent_ros.profilometry.least_squares.windows import Windows

# Standard deviations of the bands' edges, in those of the windows.
_SCALES = (1.0, 2.0, 4.0, 8.0)
# Energy is a mean over so many times the width of a band's coarser edge; what exceeds so many
# times the noise is signal; and so much of the signal is expected in the next finer band.
_NEIGHBOURHOOD = 1.5
_NOISE = 2.0
_HANDED_DOWN = 0.06
_MEDIAN_OF_SQUARE = 0.4549
_EVERY = 2  # node that the noise is measured at
# Variance that shrinkage hides, as a factor, and that of a fit without any noise, radians^2.
_UNSEEN = 1.45
_SYSTEMATIC = 6e-8
# Nodes of noise that tell what windows make of it, and of their rim.
_SAMPLE, _SAMPLE_RIM = (192, 192), 16


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
    gain: NoiseGain,
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
    gain : NoiseGain
        Of the windows that the field has come through.
    """
    levels = [values, *(windows.wide(values, scale) for scale in _SCALES)]
    bands = [finer - coarser for finer, coarser in pairwise(levels)]
    *shares, rest = gain.shares
    variance = variance * np.float32(gain.total)
    some = (slice(None, None, _EVERY), slice(None, None, _EVERY))
    sample = inside[some]
    finest = np.square(bands[0][some][sample]) / variance[some][sample]
    factor = median(finest) / _MEDIAN_OF_SQUARE / shares[0]
    noise = np.maximum(np.float32(factor) * variance, np.float32(1e-12))
    result = levels[-1].copy()
    left = np.float32(rest) * noise
    signal = np.zeros_like(values)
    for band, share, scale in reversed(list(zip(bands, shares, _SCALES, strict=True))):
        energy = windows.wide(band * band, _NEIGHBOURHOOD * scale)
        here = np.float32(share) * noise
        signal = np.maximum(energy - np.float32(_NOISE) * here, np.float32(_HANDED_DOWN) * signal)
        weight = signal / (signal + here)
        result += weight * band
        left += weight * here
    return Shrunk(result, np.float32(_UNSEEN) * left + np.float32(_SYSTEMATIC))


@dataclass(frozen=True)
class NoiseGain:
    """What becomes of white noise of variance 1 in the products of bins.

    Attributes
    ----------
    total : float
        Its variance in the phase, for fringes of amplitude 1.
    shares : tuple of float
        Parts of it in the bands, from fine to coarse, and below them all.
    """

    total: float
    shares: tuple[float, ...]


def noise_through(grid: Grid, windows: Windows, fits: int) -> NoiseGain:
    """Send noise through `fits` windows, each of which corrects the ones before."""
    rows, columns = _SAMPLE
    noise = np.random.default_rng(0).standard_normal((rows, columns * grid.bins), np.float32)
    bin_size = noise.shape[::-1]
    field = np.zeros(_SAMPLE, np.float32)
    for _ in range(fits):
        known = cv2.resize(field, bin_size, interpolation=cv2.INTER_LINEAR)
        field = field + windows.gaussian(grid.at_nodes(noise - known))
    levels = [field, *(windows.wide(field, scale) for scale in _SCALES)]
    pieces = [finer - coarser for finer, coarser in pairwise(levels)]
    inner = slice(_SAMPLE_RIM, -_SAMPLE_RIM)
    variances = [float(np.square(piece[inner, inner]).mean()) for piece in (*pieces, levels[-1])]
    total = float(np.square(field[inner, inner]).mean())
    # Half of the noise is in phase with the fringes, and the amplitude counts twice.
    return NoiseGain(2 * total, tuple(variance / total for variance in variances))
