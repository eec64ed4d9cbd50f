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
from ftp_dent_ros.profilometry.least_squares.windows import Windows, coarsened, interpolated

# Standard deviations of the bands' edges, in those of the windows. The bands are differences of
# flat-tops, which leave nothing of a smooth dent in the finer ones.
_SCALES = (1.4, 2.8, 5.6, 11.2)
# Energy is a mean over so many times the width of a band's coarser edge; what exceeds so many
# times the noise is signal.
_NEIGHBOURHOOD = 0.75
_NOISE = 4.0
# Signal that is expected in a band for that in the next coarser one: a part of the ratio of the
# two bands before, within limits.
_HANDED_DOWN, _LEAST_DOWN, _MOST_DOWN = 0.3, 0.001, 0.24
_MEDIAN_OF_SQUARE = 0.4549
# Variance of noise over what a fit's residual shows of it.
_FITTED = 1.45
_LEAST = 1e-12
_EVERY = 2  # nodes along u and v that noise and gains are estimated for together
# Variance that shrinkage hides, as a factor, and that of a fit without any noise, radians^2.
_UNSEEN = 1.7
_SYSTEMATIC = 2e-8
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
    bands, base = _split(values, windows)
    *shares, rest = gain.shares
    together = (_EVERY, _EVERY)
    coarse = Windows(windows.sigma_u / _EVERY, windows.sigma_v / _EVERY)
    noise = coarsened(variance, together) * np.float32(gain.total)
    some = (slice(None, None, _EVERY), slice(None, None, _EVERY))
    sample = inside[some]
    factors = [
        median(np.square(band[some][sample]) / noise[sample]) / (_MEDIAN_OF_SQUARE * share)
        for band, share in zip(bands[:2], shares[:2], strict=True)
    ]
    noise *= np.float32(factors[0])
    # Ripples of the fringes are in the finest band alone.
    part = np.float32(min(1.0, max(factors[1], gain.white) / factors[0]))
    np.maximum(noise, np.float32(_LEAST), out=noise)
    left = part * np.float32(rest) * noise
    coarser, expected = np.float32(np.inf), np.float32(0)
    for band, share, scale in reversed(list(zip(bands, shares, _SCALES, strict=True))):
        energy = coarse.wide(coarsened(band * band, together), _NEIGHBOURHOOD * scale)
        here = np.float32(share) * noise
        signal = np.maximum(energy - np.float32(_NOISE) * here, expected)
        falling = np.clip(_HANDED_DOWN * (signal / coarser), _LEAST_DOWN, _MOST_DOWN)
        coarser, expected = np.maximum(signal, _LEAST), falling * signal
        weight = signal / (signal + here)
        left += (1 if band is bands[0] else part) * weight * here
        band *= interpolated(weight, values.shape)
        base += band
    left = interpolated(left, values.shape)
    return Shrunk(base, np.float32(_UNSEEN) * left + np.float32(_SYSTEMATIC))


def _split(
    values: NDArray[np.float32], windows: Windows
) -> tuple[list[NDArray[np.float32]], NDArray[np.float32]]:
    """Bands from fine to coarse, and what is below them."""
    levels = [values, *(windows.wide_flat_top(values, scale) for scale in _SCALES)]
    return [finer - coarser for finer, coarser in pairwise(levels)], levels[-1]


@dataclass(frozen=True)
class NoiseGain:
    """What becomes of white noise of variance 1 in the products of bins.

    Attributes
    ----------
    total : float
        Its variance in the phase, for fringes of amplitude 1.
    shares : tuple of float
        Parts of it in the bands, from fine to coarse, and below them all.
    white : float
        Factor on what a fit's residual predicts, for noise that is white in the pixels.
    """

    total: float
    shares: tuple[float, ...]
    white: float


def noise_through(grid: Grid, windows: Windows, fits: int, period: float) -> NoiseGain:
    """Send noise through `fits` windows, each of which corrects the ones before.

    Fringes have a `period` in bins.
    """
    rows, columns = _SAMPLE
    noise = np.random.default_rng(0).standard_normal((rows, columns * grid.bins), np.float32)
    bin_size = noise.shape[::-1]
    field = np.zeros(_SAMPLE, np.float32)
    for _ in range(fits):
        known = cv2.resize(field, bin_size, interpolation=cv2.INTER_LINEAR)
        field = field + windows.gaussian(grid.at_nodes(noise - known))
    bands, base = _split(field, windows)
    inner = slice(_SAMPLE_RIM, -_SAMPLE_RIM)
    variances = [float(np.square(piece[inner, inner]).mean()) for piece in (*bands, base)]
    total = float(np.square(field[inner, inner]).mean())
    # Half of the noise is in phase with the fringes, and the amplitude counts twice.
    shares = tuple(variance / total for variance in variances)
    return NoiseGain(2 * total, shares, _FITTED * grid.density_at(period))
