"""How far the bare skin strays from its contour by chance, at each scale of averaging."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.lattice import Lattice
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Cells that a median is taken of, about.
_ENOUGH = 5000
#: Standard deviations that one place does not stray by chance: it does in one of two million.
SURE = 5.0
# Below this no cloud is trusted, metres.
_LEAST = 5e-7
# Over which noise is correlated where the cloud states none, metres.
_SHORT = 1.5e-3
# Cells between the points of a second difference: more than their noise is correlated over.
_LAG = 3

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviation of the deviation map after smoothing by Gaussians.

    Two parts: what the cloud states of each place, in the measure in which its points stray (the
    variance of unit weight of an adjustment), which falls with the scale like noise that is
    correlated over a `reach`; and what is everywhere alike beyond that, measured at each scale.

    Attributes
    ----------
    scales, common : ndarray, shape (n,)
        Standard deviations of Gaussians, metres, the first 0; and the second part after them.
    stated : ndarray, shape (rows, columns), float32
        First part of the lattice's cells as they are, metres.
    reach : float
        Over which the first part is correlated, metres.
    """

    scales: NDArray[np.float64]
    common: NDArray[np.float64]
    stated: Map
    reach: float

    def after(self, scale: float, stated: NDArray | float | None = None) -> NDArray:
        """Standard deviation after a Gaussian of `scale` metres, of each cell, metres.

        Or where the first part is `stated`.
        """
        first = self.stated if stated is None else stated
        left = np.float32(_left(scale, self.reach))
        alike = np.float32(np.interp(scale, self.scales, self.common))
        return np.sqrt(alike * alike + np.square(left * first))

    def significant(self, rate: float) -> float:
        """Standard deviations that noise passes in so many places a square metre, at all scales.

        Of a normal field whose correlation is a Gaussian (Adler, The Geometry of Random Fields,
        1981): the expected number of its excursions, of both signs.
        """
        square = np.square(self.scales[1:]) + self.reach**2
        places = float((2 * (2 * math.pi) ** -1.5 / (2 * square)).sum())
        level = 5.0
        for _ in range(10):
            level = math.sqrt(2 * math.log(max(places * level / rate, math.e)))
        return level


def smoothed(values: Map, valid: Mask, cells: tuple[float, float]) -> Map:
    """Gaussian mean of the valid values; NaN where fewer than half of the weights are valid."""
    size = [2 * math.ceil(2.5 * sigma) + 1 for sigma in cells]

    def blurred(image: Map) -> NDArray:
        return np.asarray(
            cv2.GaussianBlur(
                image, size, cells[0], sigmaY=cells[1], borderType=cv2.BORDER_CONSTANT
            )
        )

    weight = blurred(valid.astype(np.float32))
    total = blurred(np.where(valid, values, np.float32(0)))
    return np.where(weight > 0.45, total / np.maximum(weight, 0.1), np.float32(np.nan))


def median_of(values: NDArray) -> float:
    """Median of about 5000 of the values, shape (n,), spread evenly."""
    return median(values[:: 1 + len(values) // _ENOUGH])


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
        The same, `smoothed` at each of the scales.
    bare : ndarray, shape (rows, columns), bool
        Skin without dents.
    lattice : Lattice
        Its `sigma` gives the noise's distribution over the cloud, if it is known.
    scales : tuple of float
        Metres, rising.
    """
    sample = bare & np.isfinite(deviation)
    if sample.sum() < 100:
        sample = np.isfinite(deviation)
    stated = np.zeros_like(deviation) if lattice.sigma is None else lattice.sigma
    usual = median_of(stated[sample])
    calm, rough = (_some(sample & each) for each in (stated <= usual, stated >= usual))
    reach, really = _SHORT, 1.0
    if lattice.sigma is not None:
        ratios = [_strayed(each / stated, rough) for each in (deviation, *maps)]
        # Never less: most points stray less where the cloud is in doubt, a few as much as it says.
        really = max(ratios[0], 1.0)
        # Within a cell all is alike.
        cell = max(lattice.spacing) / (2 * math.sqrt(math.pi))
        reach = max(_correlated(ratios, scales), cell)
    explained = really * median(stated.ravel()[calm])
    spreads = [_strayed(each, calm) for each in (deviation, *maps)]
    rest = [
        math.sqrt(max(spread**2 - (explained * _left(scale, reach)) ** 2, _LEAST**2))
        for spread, scale in zip(spreads, (0.0, *scales), strict=True)
    ]
    falling = np.minimum.accumulate(rest)
    return Noise(np.array((0.0, *scales)), falling, np.float32(really) * stated, reach)


def _some(mask: Mask) -> NDArray[np.intp]:
    cells = np.flatnonzero(mask)
    return cells[:: 1 + len(cells) // _ENOUGH]


def _strayed(values: Map, cells: NDArray[np.intp]) -> float:
    """Standard deviation of some cells by their median; least without any."""
    size = np.abs(values.ravel()[cells])
    size = size[np.isfinite(size)]
    return NORMAL_SPREAD * median(size) if len(size) else _LEAST


def _correlated(strayed: list[float], scales: tuple[float, ...]) -> float:
    """Over which noise is correlated, metres, as smoothing by each scale leaves it."""
    left = np.minimum(np.array(strayed[1:]) / max(strayed[0], _LEAST), 1.0)
    return float(np.median(left * scales / np.sqrt(np.maximum(1 - left * left, 0.05))))


def _left(scale: float, reach: float) -> float:
    """What a Gaussian mean leaves of noise that is correlated over `reach`."""
    return 1 / math.sqrt(1 + (scale / reach) ** 2)
