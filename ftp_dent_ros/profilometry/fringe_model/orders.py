"""Fringe orders: one likelihood for the red stripe and for the code of contrasts.

Both codes are read from one figure at the nodes: the amplitude of the coded light over that of the
light which carries no code, the red's for the stripe, the level for the contrast. Its logarithm
steps from each fringe to the next; a surface's order is the one whose steps are seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH

_TURN = 2 * math.pi
# Cells a fringe, and fringes that a cell is high: windows of half a fringe resolve no more.
_CELLS, _HIGH = 4, 1.0
# Share of the code's light that noise leaves in the stripe: a limit of logarithms.
_FLOOR = 0.05
# Steps that are seen over the code's (blur and response), and scatter by paint: all as likely.
_GAINS = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0)
_SCATTERS = (0.02, 0.05, 0.1, 0.2, 0.4)
# Degrees of freedom of the steps' Student t: paint's edges are far out.
_FREEDOM = 3.0
#: Odds of the accepted order against all others together.
ODDS = 1e3
# Share of a surface's nodes that the panel must light.
_ON_PANEL = 0.9


@dataclass(frozen=True)
class FringeOrder:
    """Order of one surface.

    Attributes
    ----------
    order : int
        Whole fringes to add to the surface's phase.
    log_odds : float
        Natural logarithm of its odds against all other orders.
    """

    order: int
    log_odds: float

    @property
    def accepted(self) -> bool:
        """Whether the odds are large enough."""
        return self.log_odds > math.log(ODDS)


class OrderLikelihood:
    """Likelihood of a pattern's orders.

    Parameters
    ----------
    pattern : Pattern
    """

    def __init__(self, pattern: Pattern) -> None:
        orders = pattern.fringe_orders
        self._first = orders.start - 1
        self._count = len(orders) + 2
        expected = np.log(
            np.maximum(_expected_amplitude(pattern, self._first, self._count), _FLOOR)
        )
        self._steps = _steps(expected[None])[0]
        self._ends = pattern.phase([0, pattern.width - 1])

    def of(
        self,
        phase: NDArray[np.float32],
        ratio: NDArray[np.float32],
        weight: NDArray[np.float32],
        inside: NDArray[np.bool_],
        rows: float,
    ) -> FringeOrder | None:
        """Order of a surface; None if no two fringes of it are seen.

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
        """
        row, column = np.nonzero(inside)
        place = phase[row, column]
        low = math.floor(float(place.min()) / _TURN + 0.25)
        cell = ((place / _TURN + 0.25 - low) * _CELLS).astype(int)
        block = row // max(1, round(_HIGH * rows))
        shape = int(block.max()) + 1, -(-(int(cell.max()) + 1) // _CELLS) * _CELLS
        index = block * shape[1] + cell
        w = weight[row, column]
        value = np.log(np.maximum(ratio[row, column], _FLOOR))
        sums = [
            np.bincount(index, each, shape[0] * shape[1]).reshape(shape) for each in (w, w * value)
        ]
        seen = sums[0] > 0
        mean = np.where(seen, sums[1] / np.maximum(sums[0], 1e-12), np.nan)
        variance = np.where(seen, 1 / np.maximum(sums[0], 1e-12), np.nan)
        step = _steps(mean)
        noise = variance[:, _CELLS:] + variance[:, :-_CELLS]
        block_, cell_ = np.nonzero(np.isfinite(step))
        if not len(block_):
            return None
        return self._best(step[block_, cell_], noise[block_, cell_], cell_, low, place)

    def _best(self, step, noise, cell, low, place) -> FringeOrder | None:
        orders = np.arange(self._first - low - self._count, self._first - low + self._count)
        shifted = place[None, :: max(1, len(place) // 500)] + _TURN * orders[:, None]
        lit = ((shifted > self._ends[0]) & (shifted < self._ends[1])).mean(axis=1) > _ON_PANEL
        orders = orders[lit]
        if not len(orders):
            return None
        where = cell[None] + (low + orders[:, None] - self._first) * _CELLS
        there = (where >= 0) & (where < len(self._steps))
        expected = np.where(there, self._steps[np.clip(where, 0, len(self._steps) - 1)], 0)
        likelihood = []
        for scatter in _SCATTERS:
            scale = np.sqrt(noise + scatter**2)
            for gain in _GAINS:
                misfit = np.square((step - gain * expected) / scale)
                each = -np.log(scale) - (_FREEDOM + 1) / 2 * np.log1p(misfit / _FREEDOM)
                # Neighbouring cells see the same windows.
                likelihood.append(each.sum(axis=1) / _CELLS)
        total = logsumexp(likelihood, axis=0)
        best = int(np.argmax(total))
        others = np.delete(total, best)
        odds = float(total[best] - logsumexp(others)) if len(others) else 0.0
        return FringeOrder(int(orders[best]), odds)


def _steps(values: NDArray) -> NDArray:
    """From each cell to the same place in the next fringe."""
    return values[:, _CELLS:] - values[:, :-_CELLS]


def _expected_amplitude(pattern: Pattern, first: int, count: int) -> NDArray[np.float64]:
    """Amplitude of the code's light in Gaussian windows at the cells, over uncoded light's."""
    samples = 64
    phase = _TURN * (first - 0.25 + np.arange(count * samples) / samples)
    cosine, sine = np.cos(phase), np.sin(phase)
    light = pattern.contrast(phase) * cosine
    if pattern.code == 'stripe':
        light = np.where(np.abs(phase) <= math.pi, -1.0, cosine)  # green and blue are off
    reach = np.arange(-3 * samples, 3 * samples + 1) / samples
    window = np.exp(-0.5 * np.square(reach / WIDTH))
    window /= window.sum()

    def mean(values):
        return np.convolve(np.pad(values, 3 * samples, 'edge'), window, mode='valid')

    level = mean(light)
    of_cosine = mean(light * cosine) - level * mean(cosine)
    of_sine = mean(light * sine) - level * mean(sine)
    centre = slice(samples // _CELLS // 2, None, samples // _CELLS)
    amplitude: NDArray[np.float64] = 2 * np.hypot(of_cosine, of_sine)[centre]
    return amplitude
