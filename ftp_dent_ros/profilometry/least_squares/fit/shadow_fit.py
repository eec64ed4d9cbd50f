"""Fringes across an edge of shadow, whose added light is fitted together with their phase.

Light from elsewhere adds to the fringes' and leaves their amplitude. Where it leaps, or grows over
a half shadow, each bin's part of it is taken off, so that no bin has to be left out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import Envelope
from ftp_dent_ros.profilometry.least_squares.fit.edges_of_light import EdgesOfLight, bridged
from ftp_dent_ros.profilometry.least_squares.fit.edges_of_shadow import (
    NEAR_DEVIATIONS,
    OFF,
    EdgeOfShadow,
    edges_of_shadow,
)
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import MaskedFit
from ftp_dent_ros.profilometry.least_squares.fit.two_sided_fit import (
    Fringes,
    OneLight,
    TwoSided,
    TwoSidedFit,
)

# Fringes beside the half shadow that tell the light of a side, and on either side that do so at
# first; on either side of a sharp edge that tell none.
_SIDE, _AT_FIRST, _SHARP = 2.2, 1.5, 0.3
# Variance of a pixel's even width and of a usual lens's blur, pixels^2.
_OPTICS = 1 / 12 + 0.6**2
_ROUNDS = 3
# Share of an edge's rows that the model must explain, and of all bins that edges cross.
_MOST, _OF_EDGES = 0.75, 0.5


class ShadowFit:
    """Fits fringes across edges of shadow.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    masked : MaskedFit
    sides : TwoSidedFit
        For sharp edges.
    """

    def __init__(
        self, grid: Grid, windows: Windows, masked: MaskedFit, sides: TwoSidedFit
    ) -> None:
        self.grid, self.windows, self.period = grid, windows, sides.period
        self._masked, self._sides = masked, sides
        self._blur = math.sqrt(grid.bin_variance + _OPTICS) / grid.step

    def fitted(
        self,
        one: OneLight,
        fringes_of: Fringes,
        envelope: Envelope | None,
        lost: NDArray[np.float32] | None,
    ) -> TwoSided | None:
        """Fringes without half shadows, or else without sharp edges; None if there are none.

        Parameters
        ----------
        one : OneLight
        fringes_of : callable
        envelope : Envelope, optional
            Of coded fringes.
        lost : ndarray, shape (rows, columns), optional
            Share of each node's window that is clipped.
        """
        edges = self._sides.edges(one, one.cosine)
        if edges is None:
            return None
        shadow = self._in_shadow(one, edges, fringes_of, envelope, lost)
        return shadow or self._sides.fitted(one, edges, fringes_of, envelope)

    def _in_shadow(
        self, one: OneLight, edges: EdgesOfLight, fringes_of: Fringes, envelope, lost
    ) -> TwoSided | None:
        """Fringes without half shadows; None if most edges are none."""
        shadows = edges_of_shadow(edges.crossed, self.period, self._blur)
        shadows = [each for each in shadows if self._adds(one, each)]
        if not shadows:
            return None
        middle = np.zeros_like(one.mask)
        for each in shadows:
            middle[each.index] |= np.abs(each.away) < 1
        shift = bridged(one.shift, middle, self.grid, self.period)
        usual, target = self._sides.even_light(one)
        for number in range(_ROUNDS):
            phase, cosine, _ = fringes_of(shift)
            lights = self._lights(one, shadows, phase, envelope, number == 0)
            shadows = [
                each.fitted(*_over_left(one.levels, lights, cosine, each), one.seen[each.index])
                for each in shadows
            ]
            if number:
                shadows = [each for each in shadows if each.soft]
            if number == _ROUNDS - 1:
                shadows = [each for each in shadows if self._explains(one, lights, cosine, each)]
            if not shadows:
                return None
            level, size, near, beside = self._light(one, lights, shadows)
            even = np.where(beside, (one.levels - level) * (target / size) + usual, one.even)
            mask = (one.mask | beside) & one.seen
            equations = self._masked.equations(phase, mask, lost, envelope)
            level, modulation, step = equations.solved(even)
            shift = shift + step
        if np.count_nonzero(edges.crossed & near) < _OF_EDGES * np.count_nonzero(edges.crossed):
            return None
        gain = np.where(beside, size / at_least(target, 1), self.grid.at_bins(one.bright))
        share, known = self._masked.share_of(beside), self._masked.share_of(near)
        shift = one.shift + share * (shift - one.shift)
        return TwoSided(
            *(shift, level, modulation, share * self.windows.gaussian(np.square(step)), even),
            *(mask, np.zeros_like(mask), beside, known),
            modulation * self.grid.at_nodes(gain),
        )

    def _lights(self, one: OneLight, shadows, phase, envelope, first: bool) -> list[Any]:
        """Level and amplitude of the left and the right sides at the bins, carried on."""
        lights = []
        for sign in (-1, 1):
            side = np.zeros_like(one.mask)
            for each in shadows:
                least = self._half(each)[:, None]
                if first:
                    least = np.maximum(least, _AT_FIRST * self.period)
                away = sign * each.away
                side[each.index] |= (away > least) & (away < least + _SIDE * self.period)
            lights.append(self._sides.light(one, side, phase, envelope))
        return lights

    def _adds(self, one: OneLight, shadow: EdgeOfShadow) -> bool:
        """Whether fringes are more alike on both sides than levels: paint changes both alike."""
        away = (_AT_FIRST + 1) * self.period
        last = one.level.shape[1] - 1
        left, right = (
            np.clip(np.rint((shadow.place + side) / self.grid.bins).astype(int), 0, last)
            for side in (-away, away)
        )
        level, size = (
            np.abs(
                np.log(
                    at_least(each[shadow.rows, right], 1) / at_least(each[shadow.rows, left], 1)
                )
            )
            for each in (one.level, one.modulation)
        )
        return bool(np.median(size) < np.median(level) / 2)

    def _half(self, shadow: EdgeOfShadow) -> NDArray[np.float64]:
        """Half the width of its half shadow, bins."""
        return np.maximum(NEAR_DEVIATIONS * shadow.deviation, _SHARP * self.period)

    def _explains(self, one: OneLight, lights, cosine, shadow: EdgeOfShadow) -> bool:
        """Whether its light is as the model says, in most of its rows."""
        rest, leap = _over_left(one.levels, lights, cosine, shadow)
        here = one.seen[shadow.index] & (np.abs(shadow.away) < self._half(shadow)[:, None])
        off = np.where(here, rest - leap * shadow.share, 0)
        size = np.where(here, leap, 0)
        good = np.square(off).sum(axis=1) < OFF**2 * np.square(size).sum(axis=1)
        seen = here.any(axis=1)
        return bool(np.count_nonzero(good & seen) > _MOST * np.count_nonzero(seen))

    def _light(self, one: OneLight, lights, shadows):
        """Level and amplitude of the bins, those in half shadow, and all that it turns."""
        (left, left_size), (right, right_size) = lights
        level, size = left.copy(), left_size.copy()
        near, beside = np.zeros_like(one.mask), np.zeros_like(one.mask)
        for each in shadows:
            index, share = each.index, each.share.astype(np.float32)
            half = self._half(each)[:, None]
            here = np.abs(each.away) < half + _SIDE * self.period
            for field, other in ((level, right), (size, right_size)):
                field[index] = np.where(
                    here, field[index] + share * (other - field)[index], field[index]
                )
            beside[index] |= here
            near[index] |= np.abs(each.away) < half
        return level, at_least(size, 1), near, beside & one.seen


def _middle(bins, shadow: EdgeOfShadow):
    """Values at the middle of an edge, one a row."""
    rows, columns = shadow.index
    middle = columns[:, shadow.reach]
    return bins[rows[:, 0], middle]


def _over_left(levels, lights, cosine, shadow: EdgeOfShadow) -> tuple[Any, Any]:
    """Light over that of the left side, and that of the right side over it."""
    index = shadow.index
    left, right = (level[index] + size[index] * cosine[index] for level, size in lights)
    return levels[index] - left, right - left
