"""Wiener's gain of each octave of the phase, against the noise that the fringes' contrast shows.

What dirt, speckle, grain and pixels add near the carrier shifts the fringes and changes their
contrast alike; the skin's shape shifts them only. So the contrast's logarithm, octave by octave,
measures the phase's noise (eq. 8), and energy beyond it is the skin's shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid

# Octaves: the widest window is 16 fringes, beyond which a quadric follows the skin.
_OCTAVES = 5
# Energy over the contrast's that shows the skin's shape: noise has it in one place of a thousand
# (chi-square of some 7 windows).
_SHOWN = 3.6
# Phase noise of white dirt over the contrast's: 1.8 to 2.4 for fringes of contrast 0.8 to 1.
_OF_DIRT = 2.0
# Noise of pixels in the finest octave over that of one window.
_OF_WINDOWS = 1.36
# Part of the contrast's energy by which the noise's strays: the chance of some 7 windows.
_CHANCE = 0.5
# Widths of windows over which noise is a mean: 9 windows count. Energy is the mean over one.
_OF_NOISE = 3.0
# From an octave to the next, noise falls to a half at least: dirt is white along u. The first two
# pass the windows of the fit alike.
_FALLS = 1.0, 0.5
# Noise beyond the widest window over the last octave's: a quarter, and a quarter of that, and on.
_BEYOND = _FALLS[1] ** 2 / (1 - _FALLS[1] ** 2)


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
    mean = _Means(grid, mask)
    floor = np.float32(_OF_WINDOWS) * posterior
    low, lows = phase * mask, [each * mask for each in changes]
    kept, variance, noise, whole = (np.zeros_like(phase) for _ in range(4))
    finest = np.ones_like(phase)
    for octave in range(_OCTAVES):
        width = WIDTH * 2**octave
        smooth, *smooths = (mean.flat_top(x, width) for x in (low, *lows))
        detail = (low - smooth) * mask
        details = [(x - s) * mask for x, s in zip(lows, smooths, strict=True)]
        contrast, amplitude = (mean.variance(x, _OF_NOISE * width) for x in details)
        if octave < 2:  # these pass the windows of the fit alike
            contrast, amplitude = (np.maximum(x, floor) for x in (contrast, amplitude))
        before, noise = noise, np.minimum(np.float32(_OF_DIRT) * contrast, amplitude)  # eq. 8
        if octave:
            noise = np.minimum(noise, np.float32(_FALLS[octave > 1]) * before)
        whole = whole + noise
        energy = mean.of(detail * detail, width)
        change = np.minimum(contrast, amplitude)
        signal = np.where(energy > noise + np.float32(_CHANCE) * change, energy - noise, 0)
        taken = change / np.maximum(energy, np.float32(1e-12))
        gain = np.where(taken < 1 / _SHOWN, 1 - taken, 0)  # eq. 9
        gain = mean.of(gain, WIDTH * width)
        kept = kept + gain * detail
        variance = variance + gain * gain * noise + np.square(1 - gain) * signal  # eq. 10
        if not octave:  # windows miss as much of dents three fringes wide
            variance = variance + signal
        finest = finest if octave else gain
        low, lows = smooth, smooths
    # At rims the widest windows are cut.
    beyond = np.float32(_BEYOND) * noise / np.square(mean.share(width))
    # So are those of the fit.
    whole = (whole + beyond) / np.square(mean.share(WIDTH))
    return Denoised((kept + low) * mask, variance + beyond, finest, whole)


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
