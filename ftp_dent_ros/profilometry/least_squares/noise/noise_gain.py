"""What becomes of the pixels' noise on its way through the fits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import NO_AVERAGE, Windows
from ftp_dent_ros.profilometry.least_squares.noise.albedo import slope_along_u, without_trend
from ftp_dent_ros.profilometry.least_squares.noise.bands import ALONG, OF_SKIN, SCALES, split
from ftp_dent_ros.profilometry.least_squares.noise.response import Response, over_rows

# Nodes of noise that tell what windows make of it, and of their rim.
_SAMPLE, _SAMPLE_RIM = (192, 192), 16
# Variance of a contrast of 0.7 over the amplitude's alone: the level has half of its square.
OF_CONTRAST = 1.25
# Gaussian fits that the amplitude has come through: one, and a flat-top of what it left.
_AMPLITUDE_FITS = 3


@dataclass(frozen=True)
class NoiseGain:
    """What becomes of white noise of variance 1 in the bins, for fringes of amplitude 1.

    Attributes
    ----------
    shares : tuple of float
        Variance of the phase in the bands, from fine to coarse, and below them all.
    slopes : tuple of float
        Of the slope of the contrast's logarithm in the bands.
    amplitudes : tuple of float
        Of the amplitude in the finer bands, without its trend.
    left_out : float
        Of what the fits leave out of their own result.
    lines : tuple of float
        Variance of the phase in the bands, and below them all, by noise that is white along u and
        the same all along v.
    averaged : tuple of float
        Of the two finest bands averaged along v, by white noise.
    """

    shares: tuple[float, ...]
    slopes: tuple[float, ...]
    amplitudes: tuple[float, ...]
    left_out: float
    lines: tuple[float, ...]
    averaged: tuple[float, ...]


def noise_through(grid: Grid, windows: Windows, response: Response) -> NoiseGain:
    """Send noise through fits, each of which corrects the ones before."""
    rows, columns = _SAMPLE
    noise = np.random.default_rng(0).standard_normal((rows, columns * grid.bins), np.float32)
    field = _through(noise, grid, windows, response.fits, grid.rows)
    bands, _ = split(field, windows)
    # Each row is one sample of what is the same all along v.
    of_row = replace(windows, sigma_v=NO_AVERAGE)
    of_lines, below = split(_through(noise, grid, of_row, response.fits, 1), of_row)
    inner = slice(_SAMPLE_RIM, -_SAMPLE_RIM)

    def variance(piece):
        # Half of the noise is in phase with the fringes, and the amplitude counts twice.
        return 2 * float(np.square(piece[inner, inner]).mean())

    shares = (*map(variance, bands), _below(grid, windows))
    contrast = _through(noise, grid, windows, _AMPLITUDE_FITS, grid.rows)
    contrast = without_trend(contrast, windows)
    slopes, _ = split(slope_along_u(contrast), windows)
    contrasts = split(contrast, windows, OF_SKIN)[0]
    of_slope = tuple(OF_CONTRAST * variance(each) for each in slopes)
    lines = tuple(variance(each) for each in (*of_lines, below))
    averaged = tuple(variance(windows.along_v(each, ALONG)) for each in bands[:2])
    amplitudes = tuple(map(variance, contrasts))
    left_out = variance(response.left_out(field))
    return NoiseGain(shares, of_slope, amplitudes, left_out, lines, averaged)


def rounding_through(
    shifts: NDArray[np.float32], grid: Grid, windows: Windows, period: float
) -> tuple[float, ...]:
    """Variance of the phase by the projector's rounding: what bands add to what is below them.

    Parameters
    ----------
    shifts : ndarray, shape (2, rows, fringes), float32
        Of the fringes' phase, radians (`Pattern.rounding_shifts`).
    grid : Grid
    windows : Windows
    period : float
        Of the fringes, pixels.

    Returns
    -------
    tuple of float
        Of the bands, from fine to coarse, and below them all, radians^2.
    """
    size = max(1, round(shifts.shape[-1] * period / grid.pitch[0])), shifts.shape[1]
    # Along v nothing is averaged: patterns whose rows are alike have no need of it.
    windows = replace(windows, sigma_v=NO_AVERAGE)
    energies: Any = 0
    for each in shifts:
        field: Any = cv2.resize(each, size, interpolation=cv2.INTER_LINEAR)
        levels = [field, *(windows.wide_flat_top(field, scale) for scale in SCALES)]
        energies = energies + np.square(levels).mean(axis=(1, 2))
    return *(float(max(fine - coarse, 0)) for fine, coarse in pairwise(energies)), float(
        energies[-1]
    )


def _below(grid, windows):
    """Variance of the phase below all bands, of which a sample has few independent values."""
    # The integral of (2 G_s - G_(sqrt(2) s))^2; half of the noise is in phase and counts fourfold.
    squares = 11 / (24 * math.pi) / (windows.sigma_u * windows.sigma_v * SCALES[-1] ** 2)
    return 2 * squares / grid.bins


def _through(noise, grid, windows, fits, rows):
    """A field that fits to noise in the bins make, of means over so many rows."""
    bin_size = noise.shape[::-1]
    field = np.zeros(_SAMPLE, np.float32)
    for _ in range(fits):
        known = cv2.resize(over_rows(field, rows), bin_size, interpolation=cv2.INTER_LINEAR)
        rest = grid.at_nodes(noise - known)
        field = field + windows.gaussian(rest)
    return field
