"""What becomes of the pixels' noise on its way through the fits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.noise.albedo import slope_along_u, without_trend
from ftp_dent_ros.profilometry.least_squares.noise.bands import ALONG, split
from ftp_dent_ros.profilometry.least_squares.noise.response import Response, over_rows

# Nodes of noise that tell what windows make of it, and of their rim.
_SAMPLE, _SAMPLE_RIM = (192, 192), 16
# A window's standard deviation that is no average, nodes.
_NOWHERE = 1e-3
# Variance of a contrast of 0.7 over the amplitude's alone: the level has half of its square.
_OF_CONTRAST = 1.25


@dataclass(frozen=True)
class NoiseGain:
    """What becomes of white noise of variance 1 in the bins, for fringes of amplitude 1.

    Attributes
    ----------
    shares : tuple of float
        Variance of the phase in the bands, from fine to coarse, and below them all.
    slopes : tuple of float
        Of the slope of the contrast's logarithm in the bands.
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
    left_out: float
    lines: tuple[float, ...]
    averaged: tuple[float, ...]


def noise_through(grid: Grid, windows: Windows, response: Response) -> NoiseGain:
    """Send noise through fits, each of which corrects the ones before."""
    rows, columns = _SAMPLE
    noise = np.random.default_rng(0).standard_normal((rows, columns * grid.bins), np.float32)
    field = _through(noise, grid, windows, response, grid.rows)
    bands, base = split(field, windows)
    # Each row is one sample of what is the same all along v.
    of_row = replace(windows, sigma_v=_NOWHERE)
    of_lines, below = split(_through(noise, grid, of_row, response, 1), of_row)
    inner = slice(_SAMPLE_RIM, -_SAMPLE_RIM)

    def variance(piece):
        # Half of the noise is in phase with the fringes, and the amplitude counts twice.
        return 2 * float(np.square(piece[inner, inner]).mean())

    shares = tuple(variance(each) for each in (*bands, base))
    slope = slope_along_u(windows.gaussian(grid.at_nodes(noise)), response.period / grid.pitch[0])
    slopes, _ = split(without_trend(slope, windows), windows)
    of_slope = tuple(_OF_CONTRAST * variance(each) for each in slopes)
    lines = tuple(variance(each) for each in (*of_lines, below))
    averaged = tuple(variance(windows.along_v(each, ALONG)) for each in bands[:2])
    return NoiseGain(shares, of_slope, variance(response.left_out(field)), lines, averaged)


def _through(noise, grid, windows, response, rows):
    """A field that fits to noise in the bins make, of means over so many rows."""
    bin_size = noise.shape[::-1]
    field = np.zeros(_SAMPLE, np.float32)
    for _ in range(response.fits):
        known = cv2.resize(over_rows(field, rows), bin_size, interpolation=cv2.INTER_LINEAR)
        rest = grid.at_nodes(noise - known)
        field = field + windows.gaussian(rest)
    return field
