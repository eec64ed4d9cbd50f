"""The noise of a photograph's pixels, measured from the photograph itself.

Fringes run along the columns, so that differences along v hold little but noise. It depends on
the light: shot noise grows with it, read noise does not, speckle goes with its square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.robust import MEDIAN_OF_SQUARE, median

# Rows of which one is looked at, and columns.
_EVERY, _EVERY_COLUMN = 16, 5
# Fourth differences, which take off fringes that are inclined, and the sum of their squares.
_WEIGHTS = np.array([1, -4, 6, -4, 1], np.float32)
_SQUARES = 70
_BINS = 16
# Levels beyond which some pixels are clipped, and have no noise.
_DARKEST, _BRIGHTEST = 2, 250
_FEWEST = 40  # differences that tell the noise of a level
_COARSE = 4  # nodes along u and v that it is told for together
_PHASES = 4  # of half a fringe, that a mean is taken over


@dataclass(frozen=True, eq=False)
class PixelNoise:
    """Noise by grey level.

    Attributes
    ----------
    variance : ndarray, shape (256,), float32
        Of a pixel of each level, grey levels^2.
    """

    variance: NDArray[np.float32]

    @classmethod
    def of(cls, *planes: NDArray, unit: float = 1.0, step: int = 1) -> PixelNoise:
        """Measure the noise of pixels.

        Parameters
        ----------
        *planes : ndarray, shape (height, width)
            One, or the lattices of a mosaic, each of which is an equal part of the light: what
            counts is the mean of their variances, by the mean of their levels.
        unit : float
            Factor from levels to grey levels.
        step : int
            Least difference of two levels.
        """
        every = _EVERY // math.isqrt(len(planes))
        samples = [_sampled(plane, every) * np.float32(unit) for plane in planes]
        level = np.mean([sample[len(_WEIGHTS) // 2] for sample in samples], axis=0)
        # Of so few values a byte is enough, and sorts fastest.
        place = np.minimum((level * (_BINS / 256)).astype(np.int8), _BINS - 1)
        brightest = np.maximum.reduce([sample.max(axis=0) for sample in samples])
        place[(level < _DARKEST) | (brightest > _BRIGHTEST)] = -1
        squares = [np.square(np.tensordot(_WEIGHTS, sample, 1)) for sample in samples]
        flat = place.ravel()
        order = np.argsort(flat, kind='stable')
        ends = np.searchsorted(flat[order], np.arange(_BINS + 1))
        level, squares = level.ravel()[order], [square.ravel()[order] for square in squares]
        levels, variances = [], []
        for inside in map(slice, ends[:-1], ends[1:]):
            if inside.stop - inside.start >= _FEWEST:
                levels.append(float(level[inside].mean()))
                middle = np.mean([median(square[inside]) for square in squares])
                variances.append(middle / (_SQUARES * MEDIAN_OF_SQUARE))
        known = np.interp(np.arange(256), levels or [0], variances or [0])
        return cls(np.maximum(known, (unit * step) ** 2 / 12).astype(np.float32))

    def at_least(self, variance: float) -> PixelNoise:
        """The same, but nowhere less than a variance, grey levels^2."""
        return PixelNoise(np.maximum(self.variance, np.float32(variance)))

    def of_fringes(
        self, level: NDArray[np.float32], modulation: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Variance of pixels as it acts on the phase of fringes and on their texture.

        Returns
        -------
        ndarray, shape (3, rows, columns)
            The mean over a fringe of ``2 sin^2 Phi``, ``2 sin^2 Phi cos Phi`` and
            ``2 sin^2 Phi cos^2 Phi`` times the variance at ``level + modulation cos Phi``, grey
            levels^2.
        """
        rows, columns = level.shape
        level, modulation = (each[::_COARSE, ::_COARSE] for each in (level, modulation))
        means: Any = np.zeros((3, *level.shape), np.float32)
        for phase in (np.arange(_PHASES) + 0.5) * np.pi / _PHASES:
            cosine = np.float32(np.cos(phase))
            seen = np.clip(level + cosine * modulation, 0, 255)
            weight = np.float32(2 * np.sin(phase) ** 2 / _PHASES)
            variance = weight * self.variance[seen.astype(np.uint8)]
            for mean in means:
                mean += variance
                variance *= cosine
        size = columns, rows
        return np.stack([cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in means])


def _sampled(plane: NDArray, every: int) -> NDArray[np.float32]:
    """Rows and those after them, shape (differences, samples along v, along u), float32."""
    count = (len(plane) - len(_WEIGHTS)) // every
    rows = [
        plane[first : first + count * every : every, ::_EVERY_COLUMN]
        for first in range(len(_WEIGHTS))
    ]
    return np.stack(rows).astype(np.float32)
