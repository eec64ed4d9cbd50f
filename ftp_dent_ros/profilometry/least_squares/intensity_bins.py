"""A photograph's colours, as bins."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.pixel_noise import PixelNoise
from ftp_dent_ros.profilometry.least_squares.windows import blurred

# Luma (ITU-R BT.601), in which the errors of demosaicing and of JPEG cancel.
_RED, _OTHERS = 0.299, 0.701
# Level up to which a pixel of a colour is not clipped; demosaicing may lower it by one.
_CLIPPED = 253
# Share of a bin, in luma, that may be clipped: noise clips some pixels below that level, by no
# more than its own standard deviation.
_FEW = 0.1
# Phase up to which green and blue are missing, and a little of their blur, radians.
_STRIPE = math.pi + 0.9
_LEAST = 1e-3
# Standard deviation over rows of bins of the ratio of the colours.
_ROWS = 2.5


@dataclass(frozen=True)
class IntensityBins:
    """Bins of a photograph, of shape (rows, columns), float32, in grey levels.

    Attributes
    ----------
    red : ndarray
        The fringes go on through the stripe in it.
    grey : ndarray
        The least noise, but no fringe in the stripe.
    noise : PixelNoise
        Of a pixel of the grey levels.
    clipping : ndarray
        Share of each bin that is clipped, in luma.
    """

    red: NDArray[np.float32]
    grey: NDArray[np.float32]
    noise: PixelNoise
    clipping: NDArray[np.float32]

    @classmethod
    def of(cls, image: NDArray[np.uint8], grid: Grid) -> IntensityBins:
        """Bins of an RGB image, shape (height, width, 3)."""
        grey: Any = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        red = grid.binned(cv2.extractChannel(image, 0))
        noise = PixelNoise.of(grey)
        return cls(red, grid.binned(grey), noise, _clipping(image, grid))

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """Bins that clipped pixels are a part of."""
        return self.clipping > _FEW

    def others(self, rows: NDArray[np.integer]) -> NDArray[np.float32]:
        """Green and blue in some rows."""
        return (self.grey[rows] - np.float32(_RED) * self.red[rows]) / np.float32(_OTHERS)

    def filled(
        self, phase: NDArray[np.float32], inside: NDArray[np.bool_], period: float
    ) -> NDArray[np.float32]:
        """Grey levels in which the stripe is a fringe like the others.

        In the stripe, the red level is taken to the grey that goes with it around.

        Parameters
        ----------
        phase : ndarray, shape (rows, columns), float32
            Absolute phase of the bins, radians.
        inside : ndarray, shape (rows, columns), bool
            Bins with fringes.
        period : float
            Of the fringes, bins.
        """
        stripe = np.abs(phase) < _STRIPE
        columns = np.flatnonzero((stripe & inside).any(axis=0))
        if not len(columns):
            return self.grey
        beside = 3 * math.ceil(period)
        band = (slice(None), slice(max(columns[0] - beside, 0), columns[-1] + beside + 1))
        red, grey, stripe = self.red[band], self.grey[band], stripe[band]
        weight = (inside[band] & ~stripe).astype(np.float32)

        def mean(values):
            return blurred(weight * values, (period, _ROWS), cv2.BORDER_CONSTANT)

        total = np.maximum(mean(np.float32(1)), _LEAST)
        mean_red, mean_grey = mean(red) / total, mean(grey) / total
        variance = mean(red * red) / total - mean_red * mean_red
        covariance = mean(red * grey) / total - mean_red * mean_grey
        slope = covariance / np.maximum(variance, _LEAST)
        filled = self.grey.copy()
        filled[band] = np.where(stripe, mean_grey + slope * (red - mean_red), grey)
        return filled


def _clipping(image: NDArray[np.uint8], grid: Grid) -> NDArray[np.float32]:
    if image.max() <= _CLIPPED:
        return np.zeros(grid.bin_shape, np.float32)
    _, colours = cv2.threshold(image, _CLIPPED, 255, cv2.THRESH_BINARY)
    return grid.binned(cv2.cvtColor(colours, cv2.COLOR_RGB2GRAY)) / np.float32(255)
