"""Fringe orders: one likelihood for the red stripe and for the code of contrasts.

Both codes are read from one figure at the nodes: the amplitude of the coded light over that of the
light which carries no code, the red's for the stripe, the level for the contrast. Its logarithm
steps from each fringe to the next; a surface's order is the one whose steps are seen.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ftp_dent_ros.errors import NoStripeError, OtherPatternError, RefusedFrameError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.checks.frame import ADVICE, described
from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, WIDTH, BinGrid
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit
from ftp_dent_ros.profilometry.fringe_model.start import Start

# Cells a fringe, each a fringe high: windows resolve no more.
_CELLS = round(1 / WIDTH)
# Share of the code's light that noise leaves: a limit of logarithms.
_FLOOR = {'stripe': 0.05, 'contrast': 0.002}
# Steps that are seen over the code's (blur and response), and scatter by paint: all as likely.
_GAINS = (0.3, 0.55, 1.0)
_SCATTERS = (0.03, 0.1, 0.3)
# Degrees of freedom of the steps' Student t: paint's edges are far out.
_FREEDOM = 3.0
# Neighbouring cells see the same windows, each of so many square fringes.
_SAME = 1 / (_CELLS * 4 * math.pi * WIDTH**2)
# Odds of the accepted order against all others together, and fringes without any code.
_ODDS = 1e3
# Odds of another order within words of the code that part them from the surface: surfaces that
# meet in whole fringes are as rare.
_PART_ODDS = _ODDS**2
# Of words, by how well they are read: half of a surface may be another's.
_WELL_READ = 0.75
# Fringes that tell their place in the code; so many rows of them are looked at together.
WORD = 8
# Fringes across an edge whose steps are of both sides: that of a step, and two deviations of a
# window on each side of it.
_EDGE = round(1 + 4 * WIDTH)
# Share of the nodes lit under any order that must be lit: all of them are if the pattern is right.
_ON_PANEL = 0.9

_UNNUMBERED = {
    'stripe': (
        'the red stripe is not seen on any surface: bring it into view on a surface that reflects '
        'green and blue, and give the rig.yaml and the pattern of this camera and projector'
    ),
    'contrast': (
        'no surface shows the code of the pattern: bring eight fringes side by side onto one '
        'surface, in focus, and give the pattern that is projected (pattern.yaml)'
    ),
}


@dataclass(frozen=True, eq=False)
class _Cells:
    """Steps of the code between the cells of a surface, from each to the same place a fringe on.

    Attributes
    ----------
    step, noise : ndarray, shape (blocks, steps), float32
        Of the logarithm, and its variance, infinite where no step is seen.
    first : int
        Fringe that the cells begin with, by the surface's own phase.
    block, cell : ndarray, shape (nodes of the surface,), integer
        Row and column of each node's cell.
    """

    step: NDArray[np.float32]
    noise: NDArray[np.float32]
    first: int
    block: NDArray[np.intp]
    cell: NDArray[np.intp]

    @classmethod
    def of(cls, phase, value, weight, inside, rows: float) -> _Cells:
        """Cells of a surface; values at the nodes, so many rows of them a fringe."""
        place = phase[inside] / math.tau + 0.25
        first = math.floor(float(place.min()))
        cell = ((place - first) * _CELLS).astype(int)
        block = np.nonzero(inside)[0] // max(1, round(rows))
        shape = int(block.max()) + 1, -(-(int(cell.max()) + 1) // _CELLS) * _CELLS
        index, w = block * shape[1] + cell, weight[inside]
        total, mean = (
            np.bincount(index, each, shape[0] * shape[1]).reshape(shape)
            for each in (w, w * value[inside])
        )
        seen = total > 0
        variance = np.where(seen, 1 / np.maximum(total, 1e-12), np.inf)
        noise = variance[:, _CELLS:] + variance[:, :-_CELLS]
        step = np.where(np.isfinite(noise), _steps(mean / np.maximum(total, 1e-12)), 0)
        return cls(step.astype(np.float32), noise.astype(np.float32), first, block, cell)


class OrderLikelihood:
    """Likelihood of a pattern's orders.

    Parameters
    ----------
    pattern : Pattern
    """

    def __init__(self, pattern: Pattern) -> None:
        self._pattern, self._floor = pattern, _FLOOR[pattern.code]
        orders = pattern.fringe_orders
        self._first = orders.start - 1
        self._count = len(orders) + 2
        expected = np.log(
            np.maximum(_expected_amplitude(pattern, self._first, self._count), self._floor)
        )
        self._steps = _steps(expected[None])[0].astype(np.float32)
        coded = np.flatnonzero(~np.isclose(self._steps, 0, atol=1e-6))
        self._coded = int(coded[0]), int(coded[-1]) + 1
        self._ends = pattern.phase([0, pattern.width - 1])
        self._has_words = pattern.code == 'contrast'

    def numbered(
        self, grid: BinGrid, light: Light, start: Start
    ) -> tuple[list[int], NDArray[np.int32]]:
        """Fringe orders that have the odds, and the index of each node's, -1 for none.

        Raises
        ------
        NoStripeError, OtherPatternError
        """
        ratio, weight = _code(light, start, grid.bins_in_window)
        orders: list[int] = []
        index = np.full(start.surface.shape, -1, np.int32)
        unexplained = 0.0  # of all surfaces' nodes, more than is explained
        sizes = np.bincount(start.surface[start.surface >= 0])
        for number in np.flatnonzero(sizes):
            nodes = start.surface == number
            parts, explained = self.parts(start.phase, ratio, weight, nodes, grid.fringe[1])
            unexplained += np.nan_to_num((1 - 2 * explained) * sizes[number])
            for order, part in parts:
                index[part] = len(orders)
                orders.append(order)
        if unexplained > 0 or not orders:
            largest = start.phase[start.surface == sizes.argmax()]
            raise self._unnumbered(unexplained > 0 or bool(np.ptp(largest) > WORD * math.tau))
        return orders, index

    def _unnumbered(self, enough: bool) -> RefusedFrameError:
        """Why no surface has a number: enough fringes with another code, or too few."""
        if enough and self._has_words:
            return OtherPatternError(
                'the code of the fringes is of another pattern than one of '
                f'{described(self._pattern)}: {ADVICE}'
            )
        return NoStripeError(_UNNUMBERED[self._pattern.code])

    def parts(
        self,
        phase: NDArray[np.float32],
        ratio: NDArray[np.float32],
        weight: NDArray[np.float32],
        inside: NDArray[np.bool_],
        rows: float,
    ) -> tuple[list[tuple[int, NDArray[np.bool_]]], float]:
        """Whole fringes to add to a surface's phase, and where.

        Two surfaces whose phases meet along an edge are taken for one; the code of each parts
        them.

        Parameters
        ----------
        phase : ndarray, shape (rows, nodes)
            Right but for whole turns, radians.
        ratio : ndarray, shape (rows, nodes)
            Amplitude of the coded light over the other's.
        weight : ndarray, shape (rows, nodes)
            Inverse variance of the ratio's logarithm.
        inside : ndarray of bool, shape (rows, nodes)
            The surface.
        rows : float
            Rows of nodes a fringe.

        Returns
        -------
        list of (int, ndarray of bool)
            Fringe order and nodes of each part; empty if no order has the odds.
        float
            Share of the code's steps that is explained; NaN if no order has the odds.
        """
        cells = _Cells.of(phase, np.log(np.maximum(ratio, self._floor)), weight, inside, rows)
        orders = self._lit_orders(cells.first, phase[inside])
        if not np.isfinite(cells.noise).any() or not len(orders):
            return [], math.nan
        none, all_rows = self._by_row(cells, orders)
        # Either all rows show the code, or some of them lie behind a step, as likely as not.
        some = np.logaddexp(all_rows, none) - math.log(2)
        total: Any = logsumexp([*all_rows.sum(axis=2), *some.sum(axis=2)], axis=0)
        best = int(np.argmax(total))
        without = logsumexp(none.sum(axis=2)) + math.log(2)
        rivals = [*np.delete(total, best), without]
        if total[best] - logsumexp(rivals) < math.log(_ODDS):
            return [], math.nan
        if not self._has_words:
            return [(int(orders[best]), inside)], 1.0
        # How well the code is read is seen where most of it is of the best order.
        found, pairs = orders[[best]], list(itertools.product(_SCATTERS, _GAINS))
        read = [_read(self._likelihood(cells, found, *pair)[0]) for pair in pairs]
        each = self._likelihood(cells, orders, *pairs[int(np.argmax(read))])
        words = _order_of_words(each, best)
        explained = self._explained(cells, words, orders + cells.first)
        # That of another pattern explains a quarter, by chance, and of a few fringes more.
        if explained < 1 - explained:
            return [], explained
        local = words[cells.block, cells.cell]
        parts = []
        for number in np.unique(local[local >= 0]):
            nodes = np.zeros(inside.shape, bool)
            nodes[inside] = local == number
            parts.append((int(orders[number]), nodes))
        return parts, explained

    def _explained(self, cells: _Cells, words, first) -> float:
        """Share of the steps' squares, in the rows of each part together, that the code explains.

        What words of two orders leave between parts is not explained.

        Parameters
        ----------
        words : ndarray, shape (blocks, cells)
            Index of each cell's order.
        first : ndarray, shape (orders,)
            Fringe that the cells begin with, by the order.
        """
        step = cells.step
        weight = 1 / (cells.noise + np.float32(_SCATTERS[1] ** 2))
        of_steps = words[:, _CELLS // 2 :][:, : step.shape[1]]
        sums = np.zeros(3)
        for number in np.unique(words[words >= 0]):
            mine = weight * (of_steps == number)
            seen = mine.sum(axis=0)
            mean = (mine * step).sum(axis=0) / np.maximum(seen, 1e-9)
            expected = self._expected(first[[number]])[0, : len(mean)]
            sums += [np.sum(seen * each) for each in (mean * expected, mean**2, expected**2)]
        of_parts = weight[of_steps >= 0].sum() / max(weight.sum(), 1e-9)
        return float(of_parts * sums[0] ** 2 / max(sums[1] * sums[2], 1e-12))

    def _lit_orders(self, low, place):
        """Orders under which the panel lights the surface."""
        orders = np.arange(self._first - low - self._count, self._first - low + self._count)
        shifted = place[None, :: max(1, len(place) // 500)] + math.tau * orders[:, None]
        lit = ((shifted > self._ends[0]) & (shifted < self._ends[1])).mean(axis=1)
        return orders[lit > _ON_PANEL * lit.max()]

    def _expected(self, first):
        """Steps of the code from fringes of some orders on, shape (orders, cells)."""
        reach = np.arange(2 * len(self._steps))
        where = reach[None] + (first[:, None] - self._first) * _CELLS
        there = (where >= 0) & (where < len(self._steps))
        return np.where(there, self._steps[np.clip(where, 0, len(self._steps) - 1)], 0)

    def _by_row(self, cells: _Cells, orders):
        """Logarithms of the likelihoods of no code and of the orders, for all scatters and gains.

        Returns
        -------
        none : ndarray, shape (pairs, 1, blocks)
        orders : ndarray, shape (pairs, orders, blocks)
        """
        scatter = np.array(_SCATTERS, np.float32)[:, None, None, None]
        gain = np.array(_GAINS, np.float32)[:, None, None]
        precision = _precision(cells.noise, scatter)
        seen = cells.step * precision
        none = _student(seen)
        ratio = np.zeros((len(orders), len(_SCATTERS), len(_GAINS), len(cells.step)), np.float32)
        for each, first in zip(ratio, cells.first + orders - self._first, strict=True):
            # Beyond the code's steps an order is like none.
            low, high = (max(end - first * _CELLS, 0) for end in self._coded)
            here = np.s_[..., low:high]
            expected = self._steps[low + first * _CELLS :][: seen[here].shape[-1]]
            each += _student(seen[here] - gain * (expected * precision[here])).sum(axis=-1)
            each -= none[here].sum(axis=-1)
        without = np.repeat((none + _log(precision)).sum(axis=-1), len(_GAINS), axis=0)
        return without, without + np.moveaxis(ratio, 0, 2).reshape(len(without), len(orders), -1)

    def _likelihood(self, cells: _Cells, orders, scatter, gain):
        """Logarithm for each step under each order, shape (orders, *step.shape)."""
        step = cells.step
        expected = self._expected(cells.first + orders)[:, : step.shape[1]]
        precision = _precision(cells.noise, np.float32(scatter))
        x = step * precision - (np.float32(gain) * expected[:, None]) * precision
        return _student(x) + _log(precision)


def _precision(noise, scatter):
    """Inverse scale of steps, zero where none is seen."""
    return 1 / np.sqrt((noise + np.square(scatter)) * np.float32(_FREEDOM))


def _student(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Logarithm of Student's t at scaled steps, but for their scale."""
    x = x * x
    x += 1
    density: Any = cv2.log(x.reshape(-1, x.shape[-1])) if x.size else x
    density *= np.float32(-(_FREEDOM + 1) / 2 * _SAME)
    return density.reshape(x.shape)


def _log(precision: NDArray[np.float32]) -> NDArray[np.float32]:
    """What their scale adds to it."""
    return np.float32(_SAME) * np.log(np.where(precision > 0, precision, 1))


def _code(light: Light, start: Start, bins: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Amplitude of the coded light over the other's, and its weight (eq. 7)."""
    if not light.has_stripe:
        return start.amplitude / np.maximum(start.level, 1), np.square(start.amplitude)
    red = np.maximum(start.own.swing, 1)
    other = LocalFit.of_mixture(start.colours[1:], light.shares[1:])
    variance = (other.rest + start.own.rest + 2 * ROUNDING) / bins
    return other.swing / red, np.square(red) / variance


def _order_of_words(each: NDArray[np.float32], best: int) -> NDArray[np.int16]:
    """Index of each cell's order as the word about it shows it; -1 where words disagree.

    Parameters
    ----------
    each : ndarray, shape (orders, blocks, steps)
        Logarithms of likelihoods.
    best : int
        Index of the whole surface's order, which other words must beat.
    """
    ahead = np.array([_of_words(e) for e in each - each[best]])
    local = np.argmax(ahead, axis=0).astype(np.int16)
    local[ahead.max(axis=0) < math.log(_PART_ODDS)] = best
    low, high = _least_and_most(local, WORD)
    # An order that no whole word of words shows is by chance.
    shown = np.unique(local[low == high])
    between = _clearest(each, shown) if len(shown) > 1 else np.int16(-1)
    local = np.where(low == high, local, between)
    # A step belongs between its two cells.
    local = np.pad(local, ((0, 0), (_CELLS // 2, _CELLS - _CELLS // 2)), 'edge')
    known = local >= 0
    low, _ = _least_and_most(np.where(known, local, np.iinfo(np.int16).max), _EDGE)
    _, high = _least_and_most(local, _EDGE)
    return np.where(known & (low == high), local, -1)


def _clearest(each: NDArray[np.float32], shown: NDArray[np.int16]) -> NDArray[np.int16]:
    """Index of each cell's order, as the word that explains best of those that hold it has it.

    In a word across an edge neither code is whole; one that ends at the edge is whole. It must
    tell its order at the odds of a part, and leave less than those of other orders.
    """
    each = each[shown]
    lags = each - each.max(axis=0)
    least = np.full(each.shape, -np.inf, np.float32)
    for across, down in itertools.product((0, 0.5, 1), repeat=2):
        place = int(across * (WORD * _CELLS - 1)), int(down * (WORD - 1))
        sums = np.array([_of_words(e, place) for e in each])
        lag = np.array([_of_words(e, place) for e in lags])
        second, first = np.sort(sums, axis=0)[-2:]
        tells = (sums == first) & (first - second > math.log(_PART_ODDS))
        np.maximum(least, np.where(tells, lag, -np.inf), out=least)
    second, first = np.sort(least, axis=0)[-2:]
    clear = np.isfinite(first) & (second < first - math.log(_ODDS))
    return np.where(clear, shown[np.argmax(least, axis=0)], -1).astype(np.int16)


def _of_words(each: NDArray[np.float32], place: tuple[int, int] = (-1, -1)) -> Any:
    """Sums of steps over the words in which each has a place, or is in the middle."""
    size = WORD * _CELLS, WORD
    words: Any = cv2.blur(each, size, anchor=place, borderType=cv2.BORDER_CONSTANT)
    return math.prod(size) * words


def _least_and_most(local: NDArray[np.int16], fringes: int) -> tuple[Any, Any]:
    """The least and the largest index within words of so many fringes."""
    around = np.ones((fringes, fringes * _CELLS), np.uint8)
    return cv2.erode(local, around), cv2.dilate(local, around)


def _steps(values: NDArray) -> NDArray:
    """From each cell to the same place in the next fringe."""
    return values[:, _CELLS:] - values[:, :-_CELLS]


def _expected_amplitude(pattern: Pattern, first: int, count: int) -> NDArray[np.float64]:
    """Amplitude of the code's light in Gaussian windows at the cells, over uncoded light's."""
    samples, beyond = 64, 3
    places = np.arange(-beyond * samples, (count + beyond) * samples)
    phase = math.tau * (first - 0.25 + places / samples)
    cosine, sine = np.cos(phase), np.sin(phase)
    light = pattern.contrast(phase) * cosine
    if pattern.code == 'stripe':
        light = np.where(np.abs(phase) <= math.pi, -1.0, cosine)  # green and blue are off
    reach = np.arange(-beyond * samples, beyond * samples + 1) / samples
    window = np.exp(-0.5 * np.square(reach / WIDTH))
    window /= window.sum()

    def mean(values):
        return np.convolve(values, window, mode='valid')

    level = mean(light)
    of_cosine = mean(light * cosine) - level * mean(cosine)
    of_sine = mean(light * sine) - level * mean(sine)
    centre = slice(samples // _CELLS // 2, None, samples // _CELLS)
    amplitude: NDArray[np.float64] = 2 * np.hypot(of_cosine, of_sine)[centre]
    return amplitude


def _read(each: NDArray[np.float32]) -> float:
    """Log-likelihood of the words that are better read than three of four."""
    high, wide = (range(0, n, WORD * c) for n, c in zip(each.shape, (1, _CELLS), strict=True))
    words = np.add.reduceat(np.add.reduceat(each, high), wide, axis=1)
    return float(np.quantile(words, _WELL_READ))
