"""Noise that is not white: correlated from pixel to pixel, or the same all along the fringes.

It shows in the finest bands, where there is little else. Medians tell of it, which leave out
dents and what else is local.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.noise.bands import ALONG
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import NoiseGain
from ftp_dent_ros.robust import MEDIAN_OF_SQUARE, median


def along_fringes(
    bands: Sequence[NDArray[np.float32]],
    variance: NDArray[np.float32],
    inside: NDArray[np.bool_],
    windows: Windows,
    gain: NoiseGain,
    every: int,
) -> float:
    """Variance of noise that goes all along the fringes, over that of what is white.

    A mean along the fringes lessens white noise by what is known, and such noise not at all. It
    shows in both of the finest bands; ripples of the fringes' own period show in one.

    Parameters
    ----------
    bands : sequence of ndarray, shape (rows, columns), float32
        Of the phase, from fine to coarse.
    variance : ndarray, float32
        Of the bins, at every so many nodes.
    inside : ndarray, shape (rows, columns), bool
    windows : Windows
    gain : NoiseGain
        Of the windows that the phase has come through.
    every : int
        Nodes along u and v of which one is looked at.

    Returns
    -------
    float
        0 where nothing is inside.
    """
    sample = inside[::every, ::every]
    if not sample.any():
        return 0.0
    told = []
    for band, averaged, line in zip(bands, gain.averaged, gain.lines, strict=False):
        mean = windows.along_v(band[:, ::every], ALONG)[::every]
        told.append(max(_energy(mean, variance, sample) - averaged, 0.0) / line)
    return min(told)


def from_pixel_to_pixel(
    finest: NDArray[np.float32],
    variance: NDArray[np.float32],
    inside: NDArray[np.bool_],
    every: int,
) -> float:
    """Factor on the variance by noise that is correlated from pixel to pixel, 1 or more.

    Parameters
    ----------
    finest : ndarray, shape (rows, columns), float32
        Band of the phase.
    variance : ndarray, float32
        Of white noise in that band, at every so many nodes.
    inside : ndarray, shape (rows, columns), bool
    every : int
        Nodes along u and v of which one is looked at.
    """
    sample = inside[::every, ::every]
    if not sample.any():
        return 1.0
    return max(1.0, _energy(finest[::every, ::every], variance, sample))


def _energy(band, variance, sample) -> float:
    """Over what normal values of the variance have, by the median of their squares."""
    return median(np.square(band[sample]) / variance[sample]) / MEDIAN_OF_SQUARE
