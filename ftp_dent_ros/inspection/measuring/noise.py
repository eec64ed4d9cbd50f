"""How far the bare skin strays from its contour by chance, at each scale of averaging."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from ftp_dent_ros.cloud.response import OF_NOISE, left_out, white_noise
from ftp_dent_ros.inspection.measuring.lattice import ENOUGH, Lattice
from ftp_dent_ros.robust import NORMAL_SPREAD, median

#: Places a square metre where noise alone passes the test. One in ten of them at most is as wide
#: as a dent, and listed as one.
RATE = 0.5
#: Standard deviations that one place does not stray by chance: it does in one of two million.
SURE = 5.0
# Below this no cloud is trusted, metres.
_LEAST = 5e-7
# Cells between the points of a second difference: more than their noise is correlated over.
_LAG = 3

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviation of the deviation map after Gaussian means.

    Two parts, both measured at each scale: one is as large as the cloud states of each place, in
    some ratio, the other is everywhere alike.

    Attributes
    ----------
    scales : ndarray, shape (n,)
        Standard deviations of the Gaussians, metres, the first 0.
    ratios, common : ndarray, shape (n,)
        Of the first part after them to what the cloud states; and the second part, metres.
    stated : ndarray, shape (rows, columns), float32
        Of the lattice's cells, metres.
    window : float
        Standard deviation of the cloud's windows, metres.
    fits : int
        In them, each of which corrects the ones before.
    freedom : ndarray, shape (n,)
        Degrees of freedom of Student's t, as which noise is distributed whose strength scatters
        from place to place, as on dirty skin.
    """

    scales: NDArray[np.float64]
    ratios: NDArray[np.float64]
    common: NDArray[np.float64]
    stated: Map
    window: float
    fits: int
    freedom: NDArray[np.float64]

    def tested(self, scale: float, stated: NDArray | float | None = None) -> NDArray:
        """`after`, as of the normal noise that passes `RATE` as rarely, of each cell, metres."""
        level, freedom = self.significant(RATE), np.interp(scale, self.scales, self.freedom)
        # Of the variance 1.
        rare = -stdtrit(freedom, ndtr(-level)) * math.sqrt(1 - 2 / freedom)
        return self.after(scale, stated) * np.float32(rare / level)

    def after(self, scale: float, stated: NDArray | float | None = None) -> NDArray:
        """Standard deviation after a Gaussian of `scale` metres, of each cell, metres.

        Or where the cloud states `stated`.
        """
        ratio, alike = (
            np.float32(np.interp(scale, self.scales, each)) for each in (self.ratios, self.common)
        )
        stated = self.stated if stated is None else stated
        return combined(alike, ratio * stated)

    def spectrum(self, square: NDArray, cell: float, stated: float) -> NDArray:
        """Of each frequency, what there is in points: of white noise of the variance 1, metres.

        As strong as a Gaussian mean finds it that has most of what it leaves there.

        Parameters
        ----------
        square : ndarray
            Half the square of angular frequencies, 1 / m^2.
        cell : float
            From one point to the next along both axes, m^2.
        stated : float
            By the cloud, metres.
        """
        white = [self.after(s, stated) / _left(s / self.window, self.fits) for s in self.scales]
        strength = np.interp(1 / (2 * np.sqrt(np.maximum(square, 1))), self.scales, white)
        variance = white_noise(0.0, self.fits)[0] / (4 * math.pi * self.window**2)
        passed = 1 - left_out(square * self.window**2, self.fits)
        return strength * passed / math.sqrt(variance * cell)

    def significant(self, rate: float) -> float:
        """Standard deviations that noise passes in so many places a square metre, at all scales.

        Of a normal field (Adler, The Geometry of Random Fields, 1981): the expected number of its
        excursions, of both signs.
        """
        frequencies = [white_noise(s / self.window, self.fits)[1] for s in self.scales[1:]]
        places = 2 * (2 * math.pi) ** -1.5 * sum(frequencies) / self.window**2
        level = 5.0
        for _ in range(10):
            level = math.sqrt(2 * math.log(max(places * level / rate, math.e)))
        return level


def combined(one: NDArray | float, other: NDArray | float) -> NDArray:
    """Deviation of a sum by those of its terms; NumPy's hypot takes seven times as long."""
    return np.sqrt(one * one + other * other)


def smoother(
    valid: Mask, cells: tuple[float, float], reach: float = 2.5, least: float = 0.45
) -> Callable[[NDArray], NDArray]:
    """Function that takes Gaussian means of values, shape (rows, columns), where they are valid.

    Parameters
    ----------
    valid : ndarray, shape (rows, columns), bool
    cells : (float, float)
        Standard deviations along x and y.
    reach : float
        How far the Gaussian goes, in standard deviations.
    least : float
        Valid part of the weights up to which the mean is NaN.
    """
    size = [2 * math.ceil(reach * sigma) + 1 for sigma in cells]
    blurred = partial(
        cv2.GaussianBlur,
        ksize=size,
        sigmaX=cells[0],
        sigmaY=cells[1],
        borderType=cv2.BORDER_CONSTANT,
    )
    weight = blurred(valid.astype(np.float32))
    divisor = np.where(weight > least, weight, np.float32(np.nan))
    return lambda values: blurred(np.where(valid, values, np.float32(0))) / divisor


def median_of(values: NDArray) -> float:
    """Median of about `ENOUGH` of the values, shape (n,), spread evenly."""
    return median(values[:: 1 + len(values) // ENOUGH])


def rough_noise(height: Map, valid: Mask) -> float:
    """Standard deviation of cells before any contour is known, from second differences, metres."""
    spreads = []
    for values, known in ((height, valid), (height.T, valid.T)):
        ends = known[2 * _LAG :] & known[: -2 * _LAG] & known[_LAG:-_LAG]
        bend = (values[2 * _LAG :] - 2 * values[_LAG:-_LAG] + values[: -2 * _LAG])[ends]
        if len(bend):
            # The skin's own curvature is their median.
            spreads.append(median_of(np.abs(bend - median_of(bend))))
    return max(NORMAL_SPREAD * min(spreads, default=0.0) / math.sqrt(6), _LEAST)


def measured_noise(
    deviation: Map, maps: list[Map], bare: Mask, lattice: Lattice, scales: tuple[float, ...]
) -> Noise:
    """Noise of a deviation map.

    Parameters
    ----------
    deviation : ndarray, shape (rows, columns), float32
        Metres; NaN where there is no contour.
    maps : list of ndarray
        The same, smoothed at each of the scales.
    bare : ndarray, shape (rows, columns), bool
        Skin without dents.
    lattice : Lattice
        Its `sigma` is the first part, if it is known.
    scales : tuple of float
        Metres, rising.
    """
    sample = bare & np.isfinite(deviation)
    if sample.sum() < 100:
        sample = np.isfinite(deviation)
    stated = np.zeros_like(deviation) if lattice.sigma is None else lattice.sigma
    usual = median_of(stated[sample])
    calm, rough = (_some(sample & each) for each in (stated <= usual, stated >= usual))
    window, fits = lattice.windows(sample, OF_NOISE)
    cell = max(lattice.spacing) / math.sqrt(12)
    found = []
    for smooth, scale in zip((deviation, *maps), (0.0, *scales), strict=True):
        # What is stated is there, at least.
        ratio = white = _left(math.hypot(scale, cell) / window, fits)
        if lattice.sigma is not None:
            ratio = max(white, _strayed(smooth / stated, rough))
        alike = _strayed(smooth, calm) ** 2 - (ratio * median(stated.ravel()[calm])) ** 2
        alike = math.sqrt(max(alike, _LEAST**2))
        strayed = smooth / combined(alike, ratio * stated)
        found.append((ratio if scale else ratio / white, alike, _freedom(strayed, sample)))
    ratios, common, freedom = np.array(found).T
    falling = np.minimum.accumulate(common)
    return Noise(np.array((0.0, *scales)), ratios, falling, stated, window, fits, freedom)


def _freedom(strayed: Map, sample: Mask) -> float:
    """Degrees of freedom of Student's t by the kurtosis, on the side that has less of it.

    Dents stray to one side, noise to both.
    """
    # One more to each side: there may be none.
    strayed = np.append(strayed[sample & np.isfinite(strayed)], (-1, 1))
    square = np.square(np.maximum([strayed, -strayed], 0))
    count = np.count_nonzero(square, axis=1)
    kurtosis = count * np.square(square).sum(axis=1) / np.square(square.sum(axis=1))
    return float(4 + 6 / max(kurtosis.min() - 3, 1e-3))


def _some(mask: Mask) -> NDArray[np.intp]:
    cells = np.flatnonzero(mask)
    return cells[:: 1 + len(cells) // ENOUGH]


def _strayed(values: Map, cells: NDArray[np.intp]) -> float:
    """Standard deviation of some cells by their median; least without any."""
    some = values.ravel()[cells]
    known = some[np.isfinite(some)]
    return NORMAL_SPREAD * median(np.abs(known)) if len(known) else _LEAST


def _left(scale: float, fits: int) -> float:
    """What a Gaussian mean leaves of noise, its width in the windows'."""
    return math.sqrt(white_noise(scale, fits)[0] / white_noise(0.0, fits)[0])
