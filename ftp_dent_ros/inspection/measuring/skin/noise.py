"""How far the bare skin strays from its contour by chance, at each scale of averaging."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Cells that a median is taken of, about.
_ENOUGH = 5000
# Below this no cloud is trusted, metres.
_LEAST = 5e-7
# Over which noise is correlated where the cloud states none, metres; and bounds of what smoothing
# leaves of noise, beyond which its correlation does not matter.
_SHORT, _LEFT = 1.5e-3, (0.02, 0.98)
# Bounds of what points really stray, as a part of what their cloud states. Never less: most points
# stray less where the cloud is in doubt, a few as much as it says.
_STATED = 1.0, 1.5
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
    common : ndarray, shape (n,)
        Second part at each of the scales, metres.
    scales : ndarray, shape (n,)
        Standard deviations of the Gaussians, metres, the first 0.
    extra : ndarray, shape (rows, columns), float32
        First part of the lattice's cells as they are, metres.
    reach : float
        Over which the first part is correlated, metres.
    """

    common: NDArray[np.float64]
    scales: NDArray[np.float64]
    extra: Map
    reach: float

    def after(self, scale: float) -> Map:
        """Standard deviation after a Gaussian of `scale` metres, of each cell."""
        left = np.float32(_left(scale, self.reach))
        # Ten times as fast as hypot, and no square is near the least number.
        return np.sqrt(np.float32(self._alike(scale) ** 2) + np.square(left * self.extra))

    def where(self, extra: float, scale: float) -> float:
        """The same where the first part is `extra`."""
        return math.hypot(self._alike(scale), _left(scale, self.reach) * extra)

    def over(self, extra: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
        """The same where the first part is each of `extra`."""
        return np.hypot(self._alike(scale), _left(scale, self.reach) * extra)

    def _alike(self, scale: float) -> float:
        for (left, low), (right, high) in self._levels:
            if scale <= right:
                return low + (high - low) / (right - left) * (scale - left)
        return high

    @cached_property
    def _levels(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """Neighbours of scales and second parts: NumPy's interpolation takes longer to call."""
        return list(pairwise(zip(self.scales.tolist(), self.common.tolist(), strict=True)))

    @cached_property
    def correlated_area(self) -> float:
        """Area whose mean counts as one independent value, square metres."""
        ratio = self.common / self.common[0]
        return float(4 * math.pi * max(np.max((self.scales * ratio) ** 2), self.reach**2))


def _strayed(values: Map, stated: Map, cells: NDArray[np.intp]) -> float:
    """Median of what some cells stray, over what their cloud states."""
    ratio = np.abs(values.ravel()[cells]) / stated.ravel()[cells]
    return median(ratio[np.isfinite(ratio)])


def _correlated(strayed: list[float], scales: tuple[float, ...]) -> float:
    """Over which noise is correlated, metres, as smoothing by each scale leaves it."""
    left = np.clip(np.array(strayed[1:]) / strayed[0], *_LEFT)
    known = np.isfinite(left)
    if not known.any():
        return _SHORT
    return float(np.median(np.array(scales)[known] / np.sqrt(1 / np.square(left[known]) - 1)))


def _left(scale: float, reach: float) -> float:
    """What a Gaussian mean leaves of noise that is correlated over `reach`."""
    return 1 / math.sqrt(1 + (scale / reach) ** 2)


def smoothed(values: Map, valid: Mask, cells: tuple[float, float]) -> Map:
    """Gaussian mean of the valid values; NaN where fewer than half of the weights are valid."""
    size = [2 * math.ceil(2.5 * sigma) + 1 for sigma in cells]

    def blurred(image: Map) -> Map:
        result = cv2.GaussianBlur(
            image, size, cells[0], sigmaY=cells[1], borderType=cv2.BORDER_CONSTANT
        )
        return np.asarray(result, np.float32)

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
        bend = values[2 * _LAG :] - 2 * values[_LAG:-_LAG] + values[: -2 * _LAG]
        bend = bend[ends]
        if len(bend) > 50:
            # The skin's own curvature is their median.
            spreads.append(median_of(np.abs(bend - median_of(bend))))
    return max(NORMAL_SPREAD * float(min(spreads, default=0)) / math.sqrt(6), _LEAST)


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
    known = np.isfinite(deviation)
    sample = bare & known
    if sample.sum() < 100:
        sample = known
    stated = lattice.sigma
    extra = stated if stated is not None else _local(deviation, sample, lattice)
    usual = median_of(extra[sample])
    calm = np.flatnonzero(sample & (extra <= usual))
    calm = calm[:: 1 + len(calm) // _ENOUGH]
    explained = 0.0
    reach = _SHORT
    if stated is not None:
        rough = np.flatnonzero(sample & (stated >= usual))
        rough = rough[:: 1 + len(rough) // _ENOUGH]
        ratios = [_strayed(values, stated, rough) for values in (deviation, *maps)]
        really = float(np.clip(NORMAL_SPREAD * ratios[0], *_STATED))
        reach = _correlated(ratios, scales)
        extra = np.float32(really) * stated
        explained = median(extra.ravel()[calm])
    common = []
    for values, scale in zip((deviation, *maps), (0.0, *scales), strict=True):
        strayed = np.abs(values.ravel()[calm])
        strayed = strayed[np.isfinite(strayed)]
        spread = NORMAL_SPREAD * median(strayed) if len(strayed) else _LEAST
        common.append(math.sqrt(max(spread**2 - (explained * _left(scale, reach)) ** 2, 0)))
    falling = np.minimum.accumulate(np.maximum(common, _LEAST))
    return Noise(falling, np.array((0.0, *scales)), extra, reach)


def _local(deviation: Map, bare: Mask, lattice: Lattice) -> Map:
    """What the noise has beyond its median, from the deviations around each cell."""
    usual = max(NORMAL_SPREAD * median_of(np.abs(deviation[bare])), _LEAST)
    clipped = np.minimum(np.abs(np.where(bare, deviation, 0)), 4 * usual)
    across, down = lattice.cells(0.02)
    wide = min(12.0, across), min(12.0, down)
    square = smoothed(np.square(clipped).astype(np.float32), bare, wide)
    beyond = np.where(np.isfinite(square), square, 0) - (1.5 * usual) ** 2
    return np.sqrt(np.maximum(beyond, 0)).astype(np.float32)
