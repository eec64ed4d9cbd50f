"""Wiener's gain of each octave of the phase, against the noise that the fringes' contrast shows.

What dirt, speckle, grain and pixels add near the carrier shifts the fringes and changes their
contrast alike; the skin's shape shifts them only. So the contrast's logarithm, octave by octave,
measures the phase's noise (eq. 8), and energy beyond it is the skin's shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ftp_dent_ros.cloud.response import OF_NOISE, left_out, squares, white_noise
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid

# Octaves: the widest window is 16 fringes, beyond which a quadric follows the skin.
_OCTAVES = 5
# Windows that an energy is the mean of, about.
_COUNT = 7
# Energy over the contrast's that shows the skin's shape: noise has it in one place of a thousand.
_SHOWN = np.float32(chdtri(_COUNT, 1e-3) / _COUNT)
# Phase noise of white dirt over the contrast's: 1.8 to 2.4 for fringes of contrast 0.8 to 1.
_OF_DIRT = 2.0
# Widths of windows over which noise is a mean: 9 windows count. Energy is the mean over one.
_AVERAGED = 3.0
# Energy over the noise's from which on the rest may be the skin's shape, at a place and all
# around: two standard deviations.
_STRAYS, _AROUND = (
    np.float32(1 + 2 * math.sqrt(2 / count)) for count in (_COUNT, _COUNT * _AVERAGED**2)
)


@dataclass(frozen=True, eq=False)
class Denoised:
    """A surface's phase at the nodes: arrays of shape (rows, nodes), float32.

    Attributes
    ----------
    phase : ndarray
        About the reference, radians.
    variance : ndarray
        Mean square error: noise that is left, and signal that is not; radians^2.
    finest : ndarray
        Gain of the finest octave.
    noise : ndarray
        Variance of the phase as it was, radians^2.
    """

    phase: NDArray[np.float32]
    variance: NDArray[np.float32]
    finest: NDArray[np.float32]
    noise: NDArray[np.float32]


def denoise(
    grid: BinGrid,
    phase: NDArray[np.float32],
    changes: Sequence[NDArray[np.float32]],
    mask: NDArray[np.float32],
    posterior: NDArray[np.float32],
) -> Denoised:
    """Denoise a surface's phase.

    Parameters
    ----------
    grid : BinGrid
    phase : ndarray, shape (rows, nodes)
        About a quadric, radians.
    changes : sequence of ndarray, shape (rows, nodes)
        Logarithms of the amplitude over the level, and of the amplitude, about quadrics. Paint
        changes the latter only, ambient light the former; noise changes both.
    mask : ndarray, shape (rows, nodes), float32
        1 on the surface, else 0.
    posterior : ndarray, shape (rows, nodes), float32
        Variance of the phase in one window by what the fit leaves, radians^2: noise is no less.
    """
    mean, white = _Means(grid, mask), _white_noise()
    low, lows = phase * mask, [each * mask for each in changes]
    kept, variance, noise, whole = (np.zeros_like(phase) for _ in range(4))
    finest = np.ones_like(phase)
    for octave in range(_OCTAVES):
        width = WIDTH * 2**octave
        smooth, *smooths = (mean.flat_top(x, width) for x in (low, *lows))
        detail = (low - smooth) * mask
        details = [(x - s) * mask for x, s in zip(lows, smooths, strict=True)]
        contrast, amplitude = (mean.variance(x, _AVERAGED * width) for x in details)
        contrast, amplitude = (
            np.maximum(x, white.energy[octave] * posterior) for x in (contrast, amplitude)
        )
        before, noise = noise, np.minimum(np.float32(_OF_DIRT) * contrast, amplitude)  # eq. 8
        if octave:  # dirt is white along u, trends of light are not
            noise = np.minimum(noise, white.energy[octave] / white.energy[octave - 1] * before)
        part = white.share[octave] * noise
        whole = whole + part
        energy = mean.of(detail * detail, width)
        change = np.minimum(contrast, amplitude)
        # Where there is shape all around, more of it is likelier than twice the change.
        around = mean.of(detail * detail, _AVERAGED * width)
        change = np.where(around > _AROUND * noise, change, np.maximum(noise, change))
        signal = np.where(energy > _STRAYS * noise, energy - noise, 0)
        taken = change / np.maximum(energy, np.float32(1e-12))
        gain = np.where(taken < 1 / _SHOWN, 1 - taken, 0)  # eq. 9
        gain = mean.of(gain, WIDTH * width)
        kept = kept + gain * detail
        variance = variance + gain * gain * part + np.square(1 - gain) * signal  # eq. 10
        if not octave:  # windows miss as much of dents three fringes wide
            variance = variance + signal
        finest = finest if octave else gain
        low, lows = smooth, smooths
    # At rims the widest windows are cut.
    beyond = white.beyond * noise / np.square(mean.share(width))
    # So are those of the fit.
    whole = (whole + beyond) / np.square(mean.share(WIDTH))
    return Denoised((kept + low) * mask, variance + beyond, finest, whole)


@dataclass(frozen=True)
class _WhiteNoise:
    """White noise of the light, as the phase has it in each octave.

    Attributes
    ----------
    energy : tuple of float32
        Mean square over the variance in one window.
    share : tuple of float32
        What the variance loses with the octave, over that: neighbouring octaves are correlated.
    beyond : float32
        Variance beyond the widest window, over the last octave's energy.
    """

    energy: tuple[np.float32, ...]
    share: tuple[np.float32, ...]
    beyond: np.float32


@cache
def _white_noise() -> _WhiteNoise:
    square, step = squares()
    left = 1 - left_out(square, OF_NOISE)
    energy, after = [], [white_noise()[0]]
    for octave in range(_OCTAVES):
        detail = left_out(square * 4**octave, 2)
        # Over a window's, which is a half.
        energy.append(2 * step * np.square(left * detail).sum())
        left = left * (1 - detail)
        after.append(2 * step * np.square(left).sum())
    lost = -np.diff(after) / energy
    return _WhiteNoise(
        tuple(np.float32(each) for each in energy),
        tuple(np.float32(each) for each in lost),
        np.float32(after[-1] / energy[-1]),
    )


class _Means:
    """Gaussian means of values at the nodes of a surface."""

    def __init__(self, grid: BinGrid, mask: NDArray[np.float32]) -> None:
        self._grid, self._mask = grid, mask
        self._shares: dict[float, NDArray[np.float32]] = {}

    def share(self, fringes):
        """Share of the surface in windows of so many fringes."""
        if fringes not in self._shares:
            self._shares[fringes] = self._share_of(self._mask, fringes)
        return self._shares[fringes]

    def of(self, values, fringes):
        """Mean over so many fringes."""
        return self._grid.smooth_nodes(values * self._mask, fringes) / self.share(fringes)

    def flat_top(self, values, fringes):
        """The mean, and the mean of what it leaves: slopes and bends pass."""
        mean = self.of(values, fringes)
        return mean + self.of(values - mean, fringes)

    def variance(self, change, fringes):
        """Mean square of a Gaussian change, by its mean absolute value: edges count less."""
        return np.float32(np.pi / 2) * np.square(self.of(np.abs(change), fringes))

    def _share_of(self, weight, fringes):
        return np.maximum(self._grid.smooth_nodes(weight, fringes), np.float32(1e-3))
