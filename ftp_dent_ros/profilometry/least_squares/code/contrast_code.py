"""Which fringe is which, by their contrast.

Each whole fringe of each row of bins has a contrast: its amplitude over its level, which paint
and light do not change. From one fringe to the next its logarithm rises, stays or falls as the
pattern's code does; of all the orders that the projector allows, the one is taken whose steps
are those seen, if the next best fits so much worse that noise cannot be the reason.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.code.expected_steps import ExpectedSteps
from ftp_dent_ros.profilometry.least_squares.code.fringe_contrast import fringe_contrasts

# Pixel rows whose contrasts are averaged.
_AVERAGED = 20.0
# Standard deviation of the contrast's logarithm by what is no noise: dirt, blur, a camera's curve.
_SCATTER = 0.02
# The most that a fringe's contrast differs from the next one's, in steps of the code.
_CLIPPED = 1.5
# Fringes that a word of the code has.
WORD = 8
# Seen steps of the contrast over the code's: blur and a camera's curve make them smaller.
_LEAST_STEP, _MOST_STEP = 0.45, 1.5
# Fringes side by side that are asked for another pattern's code: a step may be between others.
_PART = 40
# By how many variances of what an order leaves the next best must be worse; and the most that it
# may leave, in steps of the code.
_SIGNIFICANT, _LEFT = 25.0, 0.4
# Square misfit of one step, in steps of the code, that is nearest to its own order.
_FITS = 0.25


@dataclass(frozen=True, eq=False)
class Decoded:
    """The order of a set of fringes.

    Attributes
    ----------
    order : int
        To add to the numbers that the fringes had.
    significance : float
        By how much the next best order's misfit is larger, in variances of what this one leaves.
    left : float
        Root mean square of what this order leaves, in steps of the code.
    scale : float
        Steps that are seen, over those of the code.
    """

    order: int
    significance: float
    left: float
    scale: float = 1.0

    @property
    def sure(self) -> bool:
        """Whether nothing but this order explains what is seen."""
        return self.significance > _SIGNIFICANT and self.left < _LEFT


@dataclass(frozen=True, eq=False)
class ContrastSteps:
    """Steps of the contrast's logarithm from each fringe to the next, by row and fringe.

    Attributes
    ----------
    first : int
        Number of the first column's fringe, by the phase that was given.
    top : int
        First row.
    step : ndarray, shape (rows, fringes)
        From the fringe of the column to the next.
    weight : ndarray, shape (rows, fringes)
        Inverse variance; 0 where no two fringes are seen.
    amplitude : ndarray, shape (rows, fringes), optional
        Steps of the amplitude's logarithm.
    """

    first: int
    top: int
    step: NDArray[np.float32]
    weight: NDArray[np.float32]
    amplitude: NDArray[np.float32] | None = None

    @classmethod
    def of(
        cls,
        light: IntensityBins,
        phase: NDArray[np.float32],
        inside: NDArray[np.bool_],
        grid: Grid,
    ) -> ContrastSteps | None:
        """Steps in a region; None if no two fringes are seen.

        Parameters
        ----------
        light : IntensityBins
        phase : ndarray, shape (rows, columns), float32
            Of the bins, right but for whole turns, radians.
        inside : ndarray, shape (rows, columns), bool
            Bins of the region.
        grid : Grid
        """
        rows = np.flatnonzero(inside.any(axis=1))
        if not len(rows):
            return None
        top, bottom = rows[0], rows[-1] + 1
        columns = np.flatnonzero(inside.any(axis=0))
        part = slice(top, bottom), slice(columns[0], columns[-1] + 1)
        seen = inside[part] & ~light.clipped[part]
        found = fringe_contrasts(light.grey[part], phase[part], inside[part], seen)
        if not len(found.row):
            return None
        row, order = found.row, found.order
        first = int(order.min())
        shape = int(bottom - top), int(order.max()) - first + 1
        inverse = 1 / (found.variance + _SCATTER**2)
        size = 2 * int(_AVERAGED / grid.rows / 2) + 1
        fields = []
        for values in (inverse, inverse * found.logarithm, inverse * found.amplitude):
            field = np.zeros(shape, np.float32)
            field[row, order - first] = values
            fields.append(field)
        weight = fields[0]
        sums, contrast, amplitude = (
            cv2.blur(each, (1, size), borderType=cv2.BORDER_CONSTANT) for each in fields
        )
        some = np.maximum(sums, np.float32(1e-6))
        both = (weight[:, 1:] > 0) & (weight[:, :-1] > 0)
        joint = sums[:, 1:] * sums[:, :-1] / np.maximum(sums[:, 1:] + sums[:, :-1], 1)
        steps, others = (np.diff(each / some, axis=1) for each in (contrast, amplitude))
        return cls(first, int(top), steps, joint * both, others)

    @property
    def of_amplitude(self) -> ContrastSteps:
        """Steps of the amplitude's logarithm instead: light that is added does not change it."""
        return self if self.amplitude is None else replace(self, step=self.amplitude)

    def averaged(self, rows: int) -> ContrastSteps:
        """The same steps, each the mean of so many rows: fringes go on along v."""
        weight: Any = cv2.blur(self.weight, (1, rows), borderType=cv2.BORDER_CONSTANT)

        def mean(steps) -> Any:
            total = cv2.blur(self.weight * steps, (1, rows), borderType=cv2.BORDER_CONSTANT)
            return total / np.maximum(weight, np.float32(1e-6))

        amplitude = None if self.amplitude is None else mean(self.amplitude)
        # Steps of one row are means of several already: how many are new is as good as the rest.
        weight_of_all = weight * (self.weight > 0) * rows
        return replace(self, step=mean(self.step), weight=weight_of_all, amplitude=amplitude)

    def decoded(self, expected: ExpectedSteps) -> Decoded:
        """Order that the steps tell, by those that are expected."""
        weight, code, size = self.weight, expected.steps, expected.size
        rows = np.count_nonzero(weight, axis=0)
        used = np.flatnonzero(rows)
        nothing = Decoded(0, 0.0, math.inf)
        if len(used) + 1 < WORD:
            return nothing
        part = slice(used[0], used[-1] + 1)
        # Of a single place to lie at nothing says how sure it is.
        if part.stop - part.start >= len(code):
            return nothing
        weight, rows = weight[:, part], rows[part]
        step = np.clip(self.step[:, part], -_CLIPPED * size, _CLIPPED * size)
        mean = (weight * step).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-6)
        # What is left is not white: a fringe counts by the rows that it is seen in.
        count = np.minimum(2 * rows / rows.max(), 1)
        words = np.lib.stride_tricks.sliding_window_view(code, len(mean))
        along, power = words @ (count * mean), np.square(words) @ count
        scale = np.clip(along / np.maximum(power, 1e-6), _LEAST_STEP, _MOST_STEP)
        misfit = count @ np.square(mean) - 2 * scale * along + np.square(scale) * power
        best, second = np.argsort(misfit)[:2]
        scatter = max(float(misfit[best]) / max(count.sum() - 2, 1), _SCATTER**2)
        return Decoded(
            expected.first + int(best) - self.first - int(used[0]),
            float(misfit[second] - misfit[best]) / scatter,
            math.sqrt(scatter) / size,
            float(scale[best]),
        )

    def of_another_pattern(self, pattern: Pattern) -> bool:
        """Whether the steps, or those of a part, are of another code than the pattern's."""
        parts = [self]
        for left in range(0, self.step.shape[1] - _PART // 2, _PART // 2):
            place = slice(None), slice(left, left + _PART)
            parts.append(ContrastSteps(self.first + left, 0, self.step[place], self.weight[place]))
        others = list(ExpectedSteps.of_others(pattern))
        return any(part.decoded(each).sure for part in parts for each in others)

    def misfit(self, expected: ExpectedSteps, order: int, scale: float) -> NDArray[np.float32]:
        """Square of what an order leaves of each step, in steps as they are seen, at most 1."""
        return np.minimum(np.square(self._rest(expected, order, scale)), 1)

    def misfit_but_for_edges(
        self, expected: ExpectedSteps, order: int, scale: float
    ) -> NDArray[np.float32]:
        """As `misfit`, but 0 for the steps to and from a fringe that alone is amiss.

        An edge runs through it: over it, from the fringe before to the one after, the code is
        right, and so are two steps on either side.
        """
        rest = self._rest(expected, order, scale)
        misfit = np.minimum(np.square(rest), 1)
        if misfit.shape[1] < 6:
            return misfit
        fits = (misfit < _FITS) & (self.weight > 0)
        over = (np.square(rest[:, 2:-3] + rest[:, 3:-2]) < _FITS) & (self.weight[:, 2:-3] > 0)
        over &= fits[:, :-5] & fits[:, 1:-4] & fits[:, 4:-1] & fits[:, 5:]
        over &= ~(fits[:, 2:-3] & fits[:, 3:-2])
        misfit[:, 2:-3][over] = 0
        misfit[:, 3:-2][over] = 0
        return misfit

    def _rest(self, expected: ExpectedSteps, order: int, scale: float) -> NDArray[np.float32]:
        """What an order leaves of each step, in steps as they are seen."""
        code = expected.steps
        place = np.arange(self.step.shape[1]) + self.first + order - expected.first
        on_panel = (place >= 0) & (place < len(code))
        steps = scale * np.where(on_panel, code[np.clip(place, 0, len(code) - 1)], 0)
        rest: Any = (self.step - steps.astype(np.float32)) / np.float32(scale * expected.size)
        return rest

    def noise(self, expected: ExpectedSteps) -> NDArray[np.float32]:
        """Misfit that the steps' own scatter leads to expect, as `misfit`, but for a factor."""
        return np.float32(1 / expected.size**2) / np.maximum(self.weight, np.float32(1e-6))
