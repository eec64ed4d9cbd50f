"""The surfaces that one unwrapped phase holds, and the order of each.

A surface that ends whole fringes before another one behind it unwraps together with it: only the
contrast tells. Where it does not fit the order that most of a part has, it is asked again.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.code.contrast_code import WORD, ContrastSteps
from ftp_dent_ros.profilometry.least_squares.fit.regions import SMALLEST
from ftp_dent_ros.profilometry.least_squares.fringe_orders.choices import at_nodes, parted
from ftp_dent_ros.profilometry.least_squares.fringe_orders.doubted_pieces import (
    SCATTER,
    around,
    drop_unsure,
    most_of,
    settle,
)
from ftp_dent_ros.profilometry.least_squares.fringe_orders.pieces import continuous, pieces
from ftp_dent_ros.profilometry.pattern_check import other_code

# Pixel rows that are judged together; of mean square misfit, in steps of the code, that is
# another order's: a wrong one leaves a half on average.
_ROWS, _WRONG = 20.0, 0.3
# Fringes and rows by which the blocks that are asked overlap, over their length.
_BLOCK, _OVERLAP = 16, 2
# Misfit from which on another order may leave no more, and times as many rows for less.
_BLIND, _TIMES = 0.5, (1, 3, 9)
_WRONG_IN_NOISE = 0.45
# Orders of one part.
_MOST = 6
# Share of a part that its code tells at least.
_TOLD = 0.5
# Square misfit of one step, in steps of the code, that is nearer to another order's.
_FOREIGN = 0.5


class Numbering:
    """Numbers the fringes of a pattern.

    Parameters
    ----------
    pattern : Pattern
    grid : Grid
    period : float
        Of the fringes, pixels.
    """

    def __init__(self, pattern: Pattern, grid: Grid, period: float) -> None:
        self.pattern, self.grid, self.period = pattern, grid, period
        self._rows = 2 * int(_ROWS / grid.rows / 2) + 1

    def order(
        self, light: IntensityBins, phase: NDArray[np.float32], region: NDArray[np.bool_]
    ) -> int | None:
        """Whole fringes to add to the phase of one surface; None if its contrast does not tell.

        Parameters
        ----------
        light : IntensityBins
        phase : ndarray, shape (rows, columns), float32
            At the nodes, radians.
        region : ndarray, shape (rows, columns), bool
            Nodes of the surface.
        """
        steps = self._steps(light, phase, region)
        if steps is None:
            return None
        decoded = steps.decoded(self.pattern)
        return decoded.order if decoded.sure else None

    def surfaces(
        self, light: IntensityBins, phase: NDArray[np.float32], part: NDArray[np.int32]
    ) -> list[tuple[NDArray[np.bool_], int]]:
        """Regions, the largest first, and the whole fringes to add to the phase of each.

        Parameters
        ----------
        light : IntensityBins
        phase : ndarray, shape (rows, columns), float32
            At the nodes, continuous within each part, radians.
        part : ndarray, shape (rows, columns), int32
            Label of the part of each node; -1 for none.

        Raises
        ------
        OtherPatternError
            The code is another pattern's.
        """
        sizes = np.bincount(part[part >= 0])
        found, untold = [], {}
        for label in np.flatnonzero(sizes >= SMALLEST):
            region = part == label
            steps = self._steps(light, phase, region)
            if steps is not None:
                divided = self._divided(light, phase, region, steps)
                if sum(np.count_nonzero(each) for each, _ in divided) < _TOLD * sizes[label]:
                    untold[sizes[label]] = steps
                found += [(piece, n) for each, n in divided for piece in continuous(each, phase)]
        found.sort(key=lambda each: -np.count_nonzero(each[0]))
        # Of another code, a few fringes may look like some of this one.
        most = max(untold, default=0)
        if most > sum(np.count_nonzero(each) for each, _ in found) and untold[
            most
        ].of_another_pattern(self.pattern):
            raise other_code(self.pattern)
        return found

    def _divided(self, light, phase, region, steps) -> list[tuple[NDArray[np.bool_], int]]:
        """Surfaces of one part."""
        decoded = steps.decoded(self.pattern)
        # Where noise leaves no less than another order would, more rows are judged together.
        for times in _TIMES:
            some = steps.averaged(times * self._rows) if times > 1 else steps
            scales = {decoded.order: decoded.scale} if decoded.sure else {}
            if scales:
                local = self._local(some, *next(iter(scales.items())))
                least = self._least(some, local, times=times)
                told = least < _BLIND or times == _TIMES[-1]
                if told and not self._wrong(some, local, least).any():
                    return [(region, decoded.order)]
            # Blocks of one order each tell its scale better than a mixture does.
            scales |= self._asked(some)
            if not scales:
                return []
            each = np.stack([self._local(some, *one) for one in scales.items()])
            choice, best = each.argmin(axis=0), each.min(axis=0)
            if self._least(some, best) < _BLIND:
                break
        steps, orders = some, list(scales)
        least = self._least(steps, best, SCATTER, times)
        if decoded.sure:
            # Another order than the whole part's is believed only around where that one is wrong.
            index = orders.index(decoded.order)
            wrong: Any = self._wrong(steps, each[index], least).view(np.uint8)
            choice[cv2.dilate(wrong, np.ones((self._rows, WORD - 1), np.uint8)) == 0] = index
        choice[self._wrong(steps, best, least)] = -1
        if times > 1:
            drop_unsure(steps, self.pattern, orders, choice)
        settle(steps, self.pattern, orders, choice, best, self._rows)
        misfit = self._of_choice(steps, scales, choice)
        # Single steps tell where noise leaves less than another order would.
        foreign = (misfit > _FOREIGN) & (least <= _WRONG)
        choice = parted(choice, foreign, self.grid, times)
        label = at_nodes(choice, steps, phase, region)
        regions = []
        for index in range(len(orders)):
            for piece in pieces(label == index):
                order = self.order(light, phase, piece)
                if order is not None:
                    regions.append((piece, order))
        return regions

    def _local(self, steps: ContrastSteps, order: int, scale: float) -> NDArray[np.float32]:
        """Mean square misfit of an order around each step."""
        known = steps.weight > 0
        own, before, after = (
            around(steps.misfit(self.pattern, order + more, scale), known, self._rows)
            for more in (0, -1, 1)
        )
        # One fringe on, a change of the code looks like an edge in its place.
        edges = steps.misfit_but_for_edges(self.pattern, order, scale)
        sure = own < np.minimum(before, after)
        return np.where(sure, around(edges, known, self._rows), own)

    def _least(
        self,
        steps: ContrastSteps,
        local: NDArray[np.float32],
        scatter: float = 0.0,
        times: int = 1,
    ) -> float:
        """Misfit around a step that is another order's.

        What noise leaves of a right order, and how that scatters, the better quarter shows.
        """
        least = _WRONG if times == 1 else _WRONG_IN_NOISE
        return max(least, most_of(local[steps.weight > 0], scatter))

    def _wrong(
        self, steps: ContrastSteps, local: NDArray[np.float32], least: float
    ) -> NDArray[np.bool_]:
        """Steps around which an order does not fit, over a word's width."""
        wrong: Any = ((steps.weight > 0) & (local > least)).view(np.uint8)
        return cv2.morphologyEx(wrong, cv2.MORPH_OPEN, np.ones((self._rows, WORD // 2 + 1))) > 0

    def _asked(self, steps: ContrastSteps) -> dict[int, float]:
        """Orders that most blocks of the steps tell, and the scale of the steps under each."""
        rows, fringes = steps.step.shape
        height = 2 * self._rows
        votes: dict[int, list[float]] = {}
        for top in range(0, max(rows - height // 2, 1), height // _OVERLAP):
            for left in range(0, max(fringes - WORD // 2, 1), _BLOCK // _OVERLAP):
                place = slice(top, top + height), slice(left, left + _BLOCK)
                part = ContrastSteps(steps.first + left, 0, steps.step[place], steps.weight[place])
                decoded = part.decoded(self.pattern)
                if decoded.sure:
                    votes.setdefault(decoded.order, []).append(decoded.scale)
        most = sorted(votes, key=lambda order: -len(votes[order]))[:_MOST]
        return {order: float(np.median(votes[order])) for order in most}

    def _of_choice(self, steps, scales, choice) -> NDArray[np.float32]:
        """Misfit of each step under the order that is chosen there."""
        misfit = np.zeros(choice.shape, np.float32)
        for index, (order, scale) in enumerate(scales.items()):
            np.copyto(misfit, steps.misfit(self.pattern, order, scale), where=choice == index)
        return misfit * (steps.weight > 0)

    def _steps(self, light, phase, region) -> ContrastSteps | None:
        """Steps of the contrast in a region."""
        inside = self.grid.to_bins(region)
        # Bins at the rim lie between a node of the region and one beside it.
        values = phase * region
        for shift in (1, -1):
            beside = np.roll(region, shift, axis=1) & ~region
            values = np.where(beside, np.roll(values, shift, axis=1), values)
        return ContrastSteps.of(light, self.grid.at_bins(values), inside, self.grid)
