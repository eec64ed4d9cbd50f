"""Fringe orders: one likelihood for the red stripe and for the code of contrasts.

Both codes are read from one figure at the nodes: the amplitude of the coded light over that of the
light which carries no code, the red's for the stripe, the level for the contrast. Its logarithm
steps from each fringe to the next; a surface's order is the one whose steps are seen.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.special import logsumexp

from ftp_dent_ros.errors import NoStripeError, OtherPatternError, RefusedFrameError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.checks.frame import ADVICE, described
from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, WIDTH, BinGrid
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit
from ftp_dent_ros.profilometry.fringe_model.start import LEAP, Start

# Cells a fringe, each a fringe high: windows resolve no more.
_CELLS = round(1 / WIDTH)
# Share of the code's light that noise leaves: a limit of logarithms.
_FLOOR = {'stripe': 0.05, 'contrast': 0.002}
# Steps that are seen over the code's (blur and response), and scatter by paint: all as likely.
_GAINS = (0.3, 0.55, 1.0)
_SCATTERS = (0.03, 0.1, 0.3)
_PAIRS = list(itertools.product(_SCATTERS, _GAINS))
# Degrees of freedom of the steps' Student t: paint's edges are far out.
_FREEDOM = 3.0
# Neighbouring cells see the same windows, each of so many square fringes.
_SAME = 1 / (_CELLS * 4 * math.pi * WIDTH**2)
# Odds of the accepted order against all others together, and fringes without any code.
_ODDS = 1e3
# Log-odds against a fringe of an edge where phases meet in whole fringes: a share of all phases
# passes for no leap.
_MEETING = -math.log(LEAP / math.pi)
# Whole numbers of a minimum cut in a natural logarithm.
_PER_NAT = 1000
# Words are looked at about every so many rows and fringes.
_FEW = 4
# Of a cell without an order.
_NONE = np.iinfo(np.int16).min
# A word: so many fringes side by side show their place in the code.
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
    level : ndarray, shape (blocks, cells)
        Mean logarithm of the light's level, NaN where the surface is not.
    first : int
        Fringe that the cells begin with, by the surface's own phase.
    block, cell : ndarray, shape (nodes of the surface,), integer
        Row and column of each node's cell.
    """

    step: NDArray[np.float32]
    noise: NDArray[np.float32]
    level: NDArray[np.float32]
    first: int
    block: NDArray[np.intp]
    cell: NDArray[np.intp]

    @classmethod
    def of(cls, phase, value, weight, level, inside, rows: float) -> _Cells:
        """Cells of a surface; values at the nodes, so many rows of them a fringe."""
        place = phase[inside] / math.tau + 0.25
        first = math.floor(float(place.min()))
        cell = ((place - first) * _CELLS).astype(int)
        block = np.nonzero(inside)[0] // max(1, round(rows))
        # Of whole words.
        steps = -((_CELLS - 1 - int(cell.max())) // (_FEW * _CELLS)) * _FEW * _CELLS
        shape = int(block.max()) + 1, max(steps, 0) + _CELLS
        index, w = block * shape[1] + cell, weight[inside]
        total, mean, level, count = (
            np.bincount(index, each, shape[0] * shape[1]).reshape(shape)
            for each in (w, w * value[inside], np.log(level[inside]), np.ones_like(w))
        )
        seen = total > 0
        variance = np.where(seen, 1 / np.maximum(total, 1e-12), np.inf)
        noise = variance[:, _CELLS:] + variance[:, :-_CELLS]
        step = np.where(np.isfinite(noise), _steps(mean / np.maximum(total, 1e-12)), 0)
        level = np.divide(level, count, where=count > 0, out=np.full(shape, np.nan))
        step, noise, level = (x.astype(np.float32) for x in (step, noise, level))
        return cls(step, noise, level, first, block, cell)

    def rows(self, rows: Any) -> _Cells:
        """Some rows of the cells."""
        return replace(self, step=self.step[rows], noise=self.noise[rows], level=self.level[rows])

    def within(self, part: NDArray[np.bool_]) -> _Cells:
        """The rows and fringes of a part, with the steps between its own cells."""
        between = part[:, _CELLS:] & part[:, :-_CELLS]
        noise = np.where(between, self.noise, np.float32(np.inf))
        cells = np.flatnonzero(part.any(axis=0))
        low = cells[0] // _CELLS
        columns = np.s_[:, low * _CELLS : max(cells[-1] + 1, (low + 2) * _CELLS)]
        step, noise, level = (each[columns] for each in (self.step, noise, self.level))
        some = replace(self, step=step, noise=noise, level=level, first=self.first + low)
        return some.rows(part.any(axis=1))


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
        # Windows show fringes up to one beyond the panel's rims.
        self._ends = pattern.phase([0, pattern.width - 1]) + math.tau * np.array([-1, 1])
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
            parts, explained = self.parts(start, ratio, weight, nodes, grid.fringe[1])
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
        start: Start,
        ratio: NDArray[np.float32],
        weight: NDArray[np.float32],
        inside: NDArray[np.bool_],
        rows: float,
    ) -> tuple[list[tuple[int, NDArray[np.bool_]]], float]:
        """Whole fringes to add to a surface's phase, and where.

        Two surfaces whose phases meet along an edge are taken for one, until the code of each
        divides them.

        Parameters
        ----------
        start : Start
            With phases that are right but for whole turns.
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
        value, level = np.log(np.maximum(ratio, self._floor)), np.maximum(start.level, 1)
        cells = _Cells.of(start.phase, value, weight, level, inside, rows)
        lit = self._lit_orders(cells.first, start.phase[inside], _ON_PANEL)
        if not np.isfinite(cells.noise).any() or not len(lit):
            return [], math.nan
        by_row = self._by_row(cells, lit)
        total, without = _totals(*by_row)
        best = int(total.argmax())
        read = by_row[1][:, best].sum(axis=-1).argmax()
        local = self._cut(cells, int(lit[best]), *_PAIRS[read])
        rest = local == lit[best]
        if rest.any() and not rest.all():
            total, without = _totals(*self._by_row(cells.within(rest), lit))
        if _odds(total, best, without) < math.log(_ODDS):
            local[rest] = _NONE
        if (local == _NONE).all():
            return [], math.nan
        explained = self._explained(cells, local) if self._has_words else 1.0
        # That of another pattern explains a quarter, by chance, and of a few fringes more.
        if explained < 1 - explained:
            return [], explained
        local = local[cells.block, cells.cell]
        parts = []
        for order in np.unique(local[local != _NONE]):
            nodes = np.zeros(inside.shape, bool)
            nodes[inside] = local == order
            parts.append((int(order), nodes))
        return parts, explained

    def _cut(self, cells: _Cells, best: int, *pair: float) -> NDArray[np.int16]:
        """Order of each cell, none at edges between two (eq. 14), and where it is not certain.

        A word that shows another order, or no code, proposes one part.

        Parameters
        ----------
        best : int
            Order of the whole surface.
        *pair : float
            Scatter and gain of the steps.
        """
        place = math.tau * (np.arange(cells.level.shape[1]) / _CELLS + cells.first)
        # Far beyond the panel an order has no code.
        orders = np.append(_NONE, self._lit_orders(cells.first, place, 0))
        own = np.flatnonzero(orders == best)[0]
        few, words = cells.rows(slice(None, None, _FEW)), np.float32(0)
        # Another surface may show the code in another blur.
        by_gain = [self._words(few, orders, pair[0], gain) for gain in _GAINS]
        # A word is one, two or four of the few rows high.
        for rows in (1, 2, 4):
            likeliest = np.maximum.reduce(by_gain)
            words = np.maximum(words, likeliest - likeliest[own])
            for each in by_gain:
                each[:, :-rows] += each[:, rows:]
        words = _shown(words)
        local, lead = np.full(cells.level.shape, best, np.int16), np.float32(0)
        while words.max(initial=0) > math.log(_ODDS):
            order, row, word = map(int, np.unravel_index(words.argmax(), words.shape))
            gain = _GAINS[np.argmax([each[order, row, word] for each in by_gain])]
            more = self._likelihood(cells, orders[[order]], pair[0], gain)
            more -= self._likelihood(cells, orders[[own]], *pair)
            # A step belongs between its two cells.
            more = np.pad(more[0], ((0, 0), (_CELLS // 2, _CELLS - _CELLS // 2))) - lead
            parts, edge = _minimum_cut(more, cells.level)
            part = _joined(parts, _FEW * row, _FEW * _CELLS * word)
            if part.any():
                total, without = _totals(*self._by_row(cells.within(part), orders))
                if min(_odds(total, order, without), more[part].sum() - edge) > math.log(_ODDS):
                    local[part], lead = orders[order], lead + np.where(part, more, 0)
                # Its steps contradict the order of the surface.
                elif logsumexp(total) - math.log(len(total)) - total[own] > max(
                    math.log(2), edge - math.log(_ODDS)
                ):
                    local[part] = _NONE
            # Words in the part have shown it; outside all parts its order is not shown.
            part, parts = (x[::_FEW, :: _FEW * _CELLS][:, : words.shape[2]] for x in (part, parts))
            words[:, part] = 0
            words[order, ~parts] = 0
        around = np.ones((_EDGE, _EDGE * _CELLS), np.uint8)
        return np.where(cv2.erode(local, around) == cv2.dilate(local, around), local, _NONE)

    def _explained(self, cells: _Cells, local) -> float:
        """Share of the steps' squares, in the rows of each part together, that the code explains.

        What lies at edges between parts is not explained.

        Parameters
        ----------
        local : ndarray, shape (blocks, cells)
            Order of each cell.
        """
        step = cells.step
        weight = 1 / (cells.noise + np.float32(_SCATTERS[1] ** 2))
        of_steps = local[:, _CELLS // 2 :][:, : step.shape[1]]
        sums = np.zeros(3)
        for order in np.unique(local[local != _NONE]):
            mine = weight * (of_steps == order)
            seen = mine.sum(axis=0)
            mean = (mine * step).sum(axis=0) / np.maximum(seen, 1e-9)
            expected = self._expected(np.array([order + cells.first]), len(mean))[0]
            sums += [np.sum(seen * each) for each in (mean * expected, mean**2, expected**2)]
        of_parts = weight[of_steps != _NONE].sum() / max(weight.sum(), 1e-9)
        return float(of_parts * sums[0] ** 2 / max(sums[1] * sums[2], 1e-12))

    def _lit_orders(self, low, place, share):
        """Orders under which the panel lights more than a share of what it may light."""
        orders = np.arange(self._first - low - self._count, self._first - low + self._count)
        some = np.sort(place[:: max(1, len(place) // 500)])
        low, high = (np.searchsorted(some, end - math.tau * orders) for end in self._ends)
        return orders[high - low > share * (high - low).max()]

    def _expected(self, first, count: int):
        """So many steps of the code from fringes of some orders on, shape (orders, count)."""
        where = np.arange(count) + (first[:, None] - self._first) * _CELLS
        return np.pad(self._steps, 1).take(where + 1, mode='clip')

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
        none = _student(1 + np.square(cells.step * precision))
        ratio = np.zeros((len(orders), len(_SCATTERS), len(_GAINS), len(cells.step)), np.float32)
        for each, first in zip(ratio, cells.first + orders - self._first, strict=True):
            # Beyond the code's steps an order is like none.
            low, high = (max(end - first * _CELLS, 0) for end in self._coded)
            here = np.s_[..., low:high]
            step, scale = cells.step[here], precision[here]
            expected = self._steps[low + first * _CELLS :][: step.shape[-1]]
            each += _student(1 + np.square((step - gain * expected) * scale)).sum(axis=-1)
            each -= none[here].sum(axis=-1)
        scale = np.float32(_SAME) * np.log(np.where(precision > 0, precision, 1))
        without = np.repeat((none + scale).sum(axis=-1), len(_GAINS), axis=0)
        return without, without + np.moveaxis(ratio, 0, 2).reshape(len(without), len(orders), -1)

    def _words(self, cells: _Cells, orders, scatter, gain):
        """Logarithm for each word, one row high, under each order: (orders, rows, words)."""
        words = _FEW * self._likelihood(cells, orders, scatter, gain, _FEW * _CELLS)
        # A word has the steps before its middle, and as many behind it.
        words[..., 1:] += words[..., :-1]
        return words

    def _likelihood(self, cells: _Cells, orders, scatter, gain, together=1):
        """Logarithm for each step under each order, less what all have, (orders, rows, steps).

        Of so many steps side by side the sum.
        """
        step, scale = cells.step.T, np.square(_precision(cells.noise, np.float32(scatter))).T
        expected = np.float32(gain) * self._expected(cells.first + orders, len(step)).T
        of_cells = np.stack([1 + step * step * scale, -2 * step * scale, scale], axis=-1)
        of_orders = np.stack([np.ones_like(expected), expected, expected * expected], axis=1)
        # One logarithm of products takes less time than many.
        spread = (of_cells @ of_orders).reshape(-1, together, *step.shape[1:], len(orders))
        return _student(np.multiply.reduce(spread, axis=1)).T


def _totals(none, all_rows) -> tuple[NDArray[Any], float]:
    """Logarithms of the likelihoods of orders, and of no code, by those of their rows."""
    # Either all rows show the code, or some of them lie behind a step, as likely as not.
    some = np.logaddexp(all_rows, none) - math.log(2)
    total: Any = logsumexp([*all_rows.sum(axis=2), *some.sum(axis=2)], axis=0)
    return total, logsumexp(none.sum(axis=2)) + math.log(2)


def _odds(total: NDArray[np.floating], order: int, *without: float) -> float:
    """Logarithm of the odds of an order against all others, and what has none, together."""
    return float(total[order] - logsumexp([*np.delete(total, order), *without]))


def _precision(noise, scatter):
    """Inverse scale of steps, zero where none is seen."""
    return 1 / np.sqrt((noise + np.square(scatter)) * np.float32(_FREEDOM))


def _student(spread: NDArray[np.float32]) -> NDArray[np.float32]:
    """Logarithm of Student's t, but for its scale, at scaled steps x whose 1 + x^2 is given."""
    density: Any = cv2.log(spread.reshape(-1, spread.shape[-1])) if spread.size else spread
    return np.float32(-(_FREEDOM + 1) / 2 * _SAME) * density.reshape(spread.shape)


def _code(light: Light, start: Start, bins: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Amplitude of the coded light over the other's, and its weight (eq. 7)."""
    if not light.has_stripe:
        return start.amplitude / np.maximum(start.level, 1), np.square(start.amplitude)
    red = np.maximum(start.own.swing, 1)
    other = LocalFit.of_mixture(start.colours[1:], light.shares[1:])
    variance = (other.rest + start.own.rest + 2 * ROUNDING) / bins
    return other.swing / red, np.square(red) / variance


def _shown(words: NDArray[np.float32]) -> NDArray[np.float32]:
    """Words where an order is ahead at the odds, and likelier than all others together; else 0.

    Of many orders some are ahead by chance. No code, the first of them, is as likely as each order
    that has none there, so that the odds are enough.
    """
    rows, cells = np.nonzero(words.max(axis=0) > math.log(_ODDS))
    ahead = words[:, rows, cells]
    alone = ahead.max(axis=0) > logsumexp(ahead, axis=0) - math.log(2)
    alone |= ahead[0] > math.log(_ODDS)
    shown = np.zeros_like(words)
    shown[:, rows[alone], cells[alone]] = ahead[:, alone]
    return shown


def _joined(part: NDArray[np.bool_], row: int, cell: int) -> NDArray[np.bool_]:
    """What of a part is joined to the word about a place: the rest is another part."""
    label: Any = cv2.connectedComponents(part.view(np.uint8), connectivity=4)[1]
    word = label[row : row + _FEW, max(cell - _CELLS * WORD // 2, 0) :][:, : _CELLS * WORD]
    return np.isin(label, word[word > 0])


def _minimum_cut(
    ahead: NDArray[np.float32], level: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], float]:
    """Cells whose log-likelihood is ahead most, less the length of the edge around them (eq. 14).

    An edge costs less where the level of the light changes.

    Returns
    -------
    part : ndarray of bool
    edge : float
        Log-odds against the edge.
    """
    count, index = ahead.size, np.arange(ahead.size).reshape(ahead.shape)
    pairs = [(index[:, 1:], index[:, :-1]), (index[1:], index[:-1])]
    one, other = (
        np.concatenate([each.ravel() for each in ends]) for ends in zip(*pairs, strict=True)
    )
    length = np.repeat([1, 1 / _CELLS], [each.size for each, _ in pairs])
    change = np.square(level.flat[one] - level.flat[other])
    known = max(np.count_nonzero(change >= 0), 1)
    usual = np.nansum(change) / known + np.finfo(np.float32).tiny
    between = np.nan_to_num(_MEETING * length / (1 + change / (2 * usual)))
    gain, nodes = ahead.ravel(), np.arange(count)
    capacity = np.concatenate([between, between, np.maximum(gain, 0), np.maximum(-gain, 0)])
    source, sink = np.full(count, count), np.full(count, count + 1)
    start = np.concatenate([one, other, source, nodes])
    end = np.concatenate([other, one, nodes, sink])
    whole = np.rint(capacity * _PER_NAT).astype(np.int32)
    graph = csr_matrix((whole, (start, end)), shape=(count + 2, count + 2))
    graph.eliminate_zeros()
    left = graph - maximum_flow(graph, count, count + 1).flow
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    part = np.zeros(count + 2, bool)
    part[breadth_first_order(left, count, return_predecessors=False)] = True
    edge = between[part[one] != part[other]].sum()
    return part[:count].reshape(ahead.shape), float(edge)


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
