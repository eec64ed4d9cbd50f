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

    Two parts, both measured at each scale: one rises with what the cloud states of each place, the
    other is everywhere alike.

    Attributes
    ----------
    scales : ndarray, shape (n,)
        Standard deviations of the Gaussians, metres, the first 0.
    ratios, common : ndarray, shape (n,)
        Of the first part after them to `stated`; and the second part, metres.
    stated : ndarray, shape (n, rows, columns), float32
        What the cloud states of the lattice's cells, calibrated, and of the bare skin that each
        Gaussian takes in, metres.
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

        Or where it is `stated`, one number or a map.
        """
        ratio, alike = (
            np.float32(np.interp(scale, self.scales, each)) for each in (self.ratios, self.common)
        )
        at = np.searchsorted(self.scales, scale, 'right') - 1
        return combined(alike, ratio * (self.stated[at] if stated is None else stated))

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
        frequency = sum(white_noise(s / self.window, self.fits)[1] for s in self.scales[1:])
        level, places = 5.0, 2 * (2 * math.pi) ** -1.5 * frequency / self.window**2
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
    blurred = partial(
        cv2.GaussianBlur,
        ksize=[2 * math.ceil(reach * sigma) + 1 for sigma in cells],
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
        Its `sigma` is what the cloud states, if it does.
    scales : tuple of float
        Metres, rising.
    """
    known = np.isfinite(deviation)
    sample = bare & known if (bare & known).sum() >= 100 else known
    stated = _calibrated(
        np.full_like(deviation, _LEAST) if lattice.sigma is None else lattice.sigma,
        maps[0],
        sample,
    )
    usual = median_of(stated[sample])
    calm, rough = (_some(sample & each) for each in (stated <= usual, stated >= usual))
    window, fits = lattice.windows(sample, OF_NOISE)
    over = [stated, *(_over(stated, known, sample, *lattice.cells(scale)) for scale in scales)]
    found = []
    for smooth, scale, each in zip((deviation, *maps), (0.0, *scales), over, strict=True):
        # What is stated of rough cells is there, at least.
        white = _left(math.hypot(scale, max(lattice.spacing) / math.sqrt(12)) / window, fits)
        ratio = max(white, _strayed(smooth / each, rough))
        alike = _strayed(smooth, calm) ** 2 - (ratio * median(each.ravel()[calm])) ** 2
        alike = math.sqrt(max(alike, _LEAST**2))
        strayed = smooth / combined(alike, ratio * each)
        found.append((ratio if scale else ratio / white, alike, _freedom(strayed[sample])))
    ratios, common, freedom = np.array(found).T
    return Noise(
        np.array((0.0, *scales)),
        ratios,
        np.minimum.accumulate(common),
        np.array(over),
        window,
        fits,
        freedom,
    )


def _calibrated(stated: Map, smooth: Map, sample: Mask) -> Map:
    """What is stated of cells, corrected by how far a mean strays, from calm cells to rough ones.

    What a cloud states is a mean over many windows, and of all octaves: noise differs more from
    place to place than that does. So each tenth of the cells has a ratio of its own, which does
    not fall from calm cells to rough ones: at rims, more is stated than a mean shows. It is the
    isotonic regression (Barlow et al., Statistical Inference under Order Restrictions, 1972).
    The median of the rough half stays as it is stated.
    """
    cells = _some(sample & np.isfinite(smooth))
    tenths = np.array_split(cells[np.argsort(stated.ravel()[cells])], 10)
    level = np.log([median(stated.ravel()[each]) for each in tenths])
    ratio = np.log([max(_strayed(smooth, each), _LEAST) for each in tenths]) - level
    rising = [
        max(min(ratio[i:k].mean() for k in range(j + 1, 11)) for i in range(j + 1))
        for j in range(10)
    ]
    return stated * np.float32(np.exp(np.interp(np.log(stated), level, rising) - rising[7]))


def _over(stated: Map, known: Mask, bare: Mask, x: float, y: float) -> Map:
    """What is stated of the bare skin in a Gaussian mean, whose deviation is `x` and `y` cells.

    Of a dent's own cells more is stated than the skin has, for it bends the fringes. By
    logarithms, for one doubted place is not all. A mean of half as many cells, as at a rim, has
    twice the variance.
    """
    share = cv2.GaussianBlur(
        np.float32(known), (0, 0), x, sigmaY=y, borderType=cv2.BORDER_CONSTANT
    )
    level = smoother(bare, (x / math.sqrt(2), y / math.sqrt(2)), least=0)(np.log(stated))
    return np.where(np.isnan(level), stated, np.exp(level) / np.sqrt(np.fmax(share, 0.5)))


def _freedom(strayed: NDArray) -> float:
    """Degrees of freedom of Student's t by the kurtosis, on the side that has less of it.

    Dents stray to one side, noise to both.
    """
    # One more to each side: there may be none.
    squares = (np.append(side[side > 0], 1) ** 2 for side in (strayed, -strayed))
    return float(
        4 + 6 / max(min(np.mean(each**2) / np.mean(each) ** 2 for each in squares) - 3, 1e-3)
    )


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
