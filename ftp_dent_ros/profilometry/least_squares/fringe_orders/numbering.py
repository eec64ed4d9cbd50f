"""The surfaces that one unwrapped phase holds, and the order of each.

A surface that ends whole fringes before another one behind it unwraps together with it: only the
contrast tells. Where it does not fit the order that most of a part has, it is asked again.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.code.contrast_code import WORD, ContrastSteps
from ftp_dent_ros.profilometry.least_squares.code.expected_steps import BLURS, ExpectedSteps
from ftp_dent_ros.profilometry.least_squares.fit.regions import SMALLEST
from ftp_dent_ros.profilometry.least_squares.fringe_orders.choices import at_nodes, parted
from ftp_dent_ros.profilometry.least_squares.fringe_orders.doubted_pieces import (
    SCATTER,
    drop_unsure,
    most_of,
    settle,
)
from ftp_dent_ros.profilometry.least_squares.fringe_orders.misfits import (
    misfit_in_light,
    misfit_of,
)
from ftp_dent_ros.profilometry.least_squares.fringe_orders.pieces import continuous, pieces
from ftp_dent_ros.profilometry.pattern_check import other_code

# Pixel rows that are judged together; of mean square misfit, in steps of the code, that is
# another order's: a wrong one leaves a half on average.
_ROWS, _WRONG = 20.0, 0.3
# Fringes and rows by which the blocks that are asked overlap, over their length.
_BLOCK, _OVERLAP = 16, 2
# Blocks, or a few more, that are asked how blurred the fringes are, and how much more surely
# another blur than the usual one must tell their orders.
_ASKED, _CLEARER = 24, 2.0
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
        self._expected = [ExpectedSteps.of(pattern, blur) for blur in BLURS]
        self._rows = 2 * int(_ROWS / grid.rows / 2) + 1

    def order(
        self,
        light: IntensityBins,
        phase: NDArray[np.float32],
        region: NDArray[np.bool_],
        expected: ExpectedSteps,
    ) -> int | None:
        """Whole fringes to add to the phase of one surface; None if its contrast does not tell.

        Parameters
        ----------
        light : IntensityBins
        phase : ndarray, shape (rows, columns), float32
            At the nodes, radians.
        region : ndarray, shape (rows, columns), bool
            Nodes of the surface.
        expected : ExpectedSteps
            Of the photograph's blur, as `surfaces` returns them.
        """
        steps = self._steps(light, phase, region)
        if steps is None:
            return None
        decoded = steps.decoded(expected)
        return decoded.order if decoded.sure else None

    def surfaces(
        self, light: IntensityBins, phase: NDArray[np.float32], part: NDArray[np.int32]
    ) -> tuple[list[tuple[NDArray[np.bool_], int]], ExpectedSteps]:
        """Regions, the largest first, the fringes to add to the phase of each, and the code seen.

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
        labels = np.flatnonzero(sizes >= SMALLEST)
        steps_of = {label: self._steps(light, phase, part == label) for label in labels}
        largest = steps_of.get(sizes.argmax()) if len(labels) else None
        expected = self._blurred(largest)
        found, untold = [], {}
        for label, steps in steps_of.items():
            if steps is not None:
                divided = self._divided(light, phase, part == label, steps, expected)
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
        return found, expected

    def _blurred(self, steps: ContrastSteps | None) -> ExpectedSteps:
        """The code through the blur with which blocks of the steps tell their orders best."""
        if steps is None:
            return self._expected[0]
        blocks = list(self._blocks(steps))
        some = blocks[:: max(len(blocks) // _ASKED, 1)]
        told = [sum(part.decoded(each).significance for part in some) for each in self._expected]
        best = int(np.argmax(told))
        return self._expected[best if told[best] > _CLEARER * told[0] else 0]

    def _divided(
        self, light, phase, region, steps, expected
    ) -> list[tuple[NDArray[np.bool_], int]]:
        """Surfaces of one part."""
        decoded = steps.decoded(expected)
        # Where noise leaves no less than another order would, more rows are judged together.
        for times in _TIMES:
            some = steps.averaged(times * self._rows) if times > 1 else steps
            scales = {decoded.order: decoded.scale} if decoded.sure else {}
            if scales:
                local = misfit_in_light(some, expected, *next(iter(scales.items())), self._rows)
                least = self._least(some, local, times=times)
                told = least < _BLIND or times == _TIMES[-1]
                if told and not self._wrong(some, local, least).any():
                    return [(region, decoded.order)]
            # Blocks of one order each tell its scale better than a mixture does.
            scales |= self._asked(some, expected)
            if not scales:
                return []
            each = np.stack(
                [misfit_of(some, expected, *one, self._rows) for one in scales.items()]
            )
            choice, best = each.argmin(axis=0), each.min(axis=0)
            if self._least(some, best, SCATTER, times) < _BLIND:
                break
        steps, orders = some, list(scales)
        least = self._least(steps, best, SCATTER, times)
        if decoded.sure:
            # Another order than the whole part's is believed only around where that one is wrong.
            wrong: Any = self._wrong(steps, each[0], least).view(np.uint8)
            choice[cv2.dilate(wrong, np.ones((self._rows, WORD - 1), np.uint8)) == 0] = 0
        choice[self._wrong(steps, best, least)] = -1
        if times > 1:
            drop_unsure(steps, expected, orders, choice)
        fits = local < least if decoded.sure else np.zeros(choice.shape, bool)
        settle(steps, expected, orders, choice, best, fits, self._rows)
        misfit = self._of_choice(steps, expected, scales, choice)
        # Single steps tell where noise leaves less than another order would.
        foreign = (misfit > _FOREIGN) & (least <= _WRONG)
        choice = parted(choice, foreign, self.grid, times)
        label = at_nodes(choice, steps, phase, region)
        regions = []
        for index in range(len(orders)):
            for piece in pieces(label == index):
                order = self.order(light, phase, piece, expected)
                if order is not None:
                    regions.append((piece, order))
        return regions

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

    def _asked(self, steps: ContrastSteps, expected: ExpectedSteps) -> dict[int, float]:
        """Orders that most blocks of the steps tell, and the scale of the steps under each."""
        votes: dict[int, list[float]] = {}
        for part in self._blocks(steps):
            decoded = part.decoded(expected)
            if decoded.sure:
                votes.setdefault(decoded.order, []).append(decoded.scale)
        most = sorted(votes, key=lambda order: -len(votes[order]))[:_MOST]
        return {order: float(np.median(votes[order])) for order in most}

    def _blocks(self, steps: ContrastSteps) -> Iterator[ContrastSteps]:
        """The steps in blocks over one another."""
        rows, fringes = steps.step.shape
        height = 2 * self._rows
        for top in range(0, max(rows - height // 2, 1), height // _OVERLAP):
            for left in range(0, max(fringes - WORD // 2, 1), _BLOCK // _OVERLAP):
                place = slice(top, top + height), slice(left, left + _BLOCK)
                yield ContrastSteps(steps.first + left, 0, steps.step[place], steps.weight[place])

    def _of_choice(self, steps, expected, scales, choice) -> NDArray[np.float32]:
        """Misfit of each step under the order that is chosen there."""
        misfit = np.zeros(choice.shape, np.float32)
        for index, (order, scale) in enumerate(scales.items()):
            np.copyto(misfit, steps.misfit(expected, order, scale), where=choice == index)
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
