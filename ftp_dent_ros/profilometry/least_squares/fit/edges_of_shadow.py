"""Edges of shadow: where along each row they are, how soft, and how much light they add.

The sun is a disc: behind an edge its light grows over a half shadow, whatever the edge is an edge
of. That light adds to the fringes' and does not change how high they are, as paint does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Of the light of the sun's disc that darkens linearly towards its limb.
_LIMB = 0.6
# Variance of that disc's light along its diameter, squares of its radius: a fifth of a disc that
# is all limb, a quarter of one that has none.
_DISC = (0.25 * (1 - _LIMB) + 0.2 * _LIMB * 2 / 3) / (1 - _LIMB / 3)
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
# Rows of bins over which an edge goes straight, and that it must have at least.
_ALONG, _LEAST_ROWS = 6.0, 8
# Fringes that an edge's bins may be apart in a row, of a half shadow's widest deviation, and on
# either side of an edge over which it is looked at.
_THICK, _SOFTEST, _REACH = 1.5, 2.0, 5.0
# Share of the leap that bins may be off, standard deviation.
OFF = 0.1
_STEPS = 3
_FIRST = 1.5  # bins
# Fringes on either side of a sharp edge that tell where it is; deviations of a soft one.
_NEAR, NEAR_DEVIATIONS = 0.7, 2.5


def half_shadow(
    away: NDArray[np.float64], deviation: NDArray[np.float64], blur: float
) -> NDArray[np.float64]:
    """Share of the sun that is seen behind an edge, through what blurs a photograph.

    Parameters
    ----------
    away, deviation : ndarray
        Distance from the edge's middle, and the standard deviation of its slope, bins.
    blur : float
        Standard deviation of the photograph's own blur, bins.
    """
    square = np.square(deviation)
    disc = np.maximum(square - blur * blur, square / 4)
    smear = np.sqrt(square - disc)
    radius = np.sqrt(disc / _DISC)
    total = np.zeros(np.broadcast_shapes(away.shape, deviation.shape))
    for node, weight in zip(_NODES, _WEIGHTS / _WEIGHTS.sum(), strict=True):
        x = np.clip((away - node * smear) / radius, -1, 1)
        flat = x * np.sqrt(1 - x * x) + np.arcsin(x) + np.pi / 2
        limb = np.pi / 2 * (x - x**3 / 3 + 2 / 3)
        total += weight * ((1 - _LIMB) * flat + _LIMB * limb)
    return total / (np.pi * (1 - _LIMB / 3))


@dataclass(frozen=True, eq=False)
class EdgeOfShadow:
    """One edge, from row to row.

    Attributes
    ----------
    rows : ndarray, shape (n,), int
        Rows of bins.
    place, deviation : ndarray, shape (n,)
        Column of its middle, and standard deviation of its slope, bins.
    reach, columns : int
        Bins on either side that are looked at, and columns of all bins.
    period, blur : float
        Of the fringes, and standard deviation of the photograph's own blur, bins.
    """

    rows: NDArray[np.intp]
    place: NDArray[np.float64]
    deviation: NDArray[np.float64]
    reach: int
    columns: int
    period: float
    blur: float

    @property
    def index(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the bins around, each of shape (n, 2 reach + 1)."""
        columns = np.rint(self.place).astype(int)[:, None]
        columns = columns + np.arange(-self.reach, self.reach + 1)
        rows = np.broadcast_to(self.rows[:, None], columns.shape)
        return rows, np.clip(columns, 0, self.columns - 1)

    @property
    def away(self) -> NDArray[np.float64]:
        """Distance of these bins from its middle, bins."""
        away: NDArray[np.float64] = self.index[1] - self.place[:, None]
        return away

    @property
    def share(self) -> NDArray[np.float64]:
        """Share of the light of its right side at these bins."""
        return half_shadow(self.away, self.deviation[:, None], self.blur)

    @property
    def soft(self) -> bool:
        """Whether most of its softness is not the photograph's blur."""
        return bool(np.median(np.square(self.deviation)) > 2 * self.blur**2)

    def fitted(
        self, rest: NDArray[np.float64], leap: NDArray[np.float64], seen: NDArray[np.bool_]
    ) -> EdgeOfShadow:
        """Where it is and how soft by what is seen: Gauss-Newton's least squares.

        Parameters
        ----------
        rest, leap : ndarray, shape (n, 2 reach + 1)
            Light over that of its left side at the bins around, and that of its right side.
        seen : ndarray, shape (n, 2 reach + 1), bool
            Bins that tell.
        """
        result, (_, columns) = self, self.index
        for _ in range(_STEPS):
            result = result._step(columns - result.place[:, None], rest, leap, seen)
        return result

    def _step(self, away, rest, leap, seen) -> EdgeOfShadow:
        deviation = self.deviation[:, None]
        near = np.maximum((NEAR_DEVIATIONS + 0.5) * deviation, _NEAR * self.period)
        off = rest - leap * half_shadow(away, deviation, self.blur)
        weight = seen & (np.abs(away) < near)
        weight = weight / (1 + np.square(off / (OFF * np.abs(leap) + 1)))
        z = away / deviation
        slope = leap * np.exp(-z * z / 2) / (np.sqrt(2 * np.pi) * deviation)
        by_place, by_deviation = -slope, -slope * z
        products = (
            *(by_place * by_place, by_place * by_deviation, by_deviation * by_deviation),
            *(by_place * off, by_deviation * off),
        )
        sums = np.stack([(weight * each).sum(axis=1) for each in products], axis=1)
        first, mixed, last, p, d = _along(sums).T
        determinant = first * last - mixed * mixed + 1e-6
        moved = (last * p - mixed * d) / determinant
        wider = (first * d - mixed * p) / determinant
        most = self.deviation / 2
        softest = _SOFTEST * self.period
        return replace(
            self,
            place=self.place + np.clip(moved, -1, 1),
            deviation=np.clip(
                self.deviation + np.clip(wider, -most, most), 0.75 * self.blur, softest
            ),
        )


def edges_of_shadow(crossed: NDArray[np.bool_], period: float, blur: float) -> list[EdgeOfShadow]:
    """Edges that go from row to row, by the bins that edges of light cross.

    Parameters
    ----------
    crossed : ndarray, shape (rows, bins), bool
    period, blur : float
        Of the fringes, and standard deviation of the photograph's own blur, bins.
    """
    joined = cv2.dilate(crossed.view(np.uint8), np.ones((5, 3), np.uint8))
    count, labels = cv2.connectedComponents(joined)
    rows, columns = np.nonzero(crossed)
    labels = labels[rows, columns]
    edges = []
    for label in range(1, count):
        row, column = rows[labels == label], columns[labels == label]
        first, last = row.min(), row.max()
        size = last + 1 - first
        if size < _LEAST_ROWS:
            continue
        number = np.bincount(row - first, minlength=size)
        if np.median(number) > _THICK * period:
            continue
        total = np.bincount(row - first, column, minlength=size)
        place = _straight(total / np.maximum(number, 1), (number > 0).astype(float))
        deviation = np.full(size, _FIRST)
        reach = int(_REACH * period)
        edges.append(
            EdgeOfShadow(
                np.arange(first, last + 1), place, deviation, reach, crossed.shape[1], period, blur
            )
        )
    return edges


def _along(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of the rows around."""
    smooth: Any = cv2.GaussianBlur(
        sums, (1, 6 * int(_ALONG) + 1), sigmaX=1, sigmaY=_ALONG, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(smooth, float).reshape(sums.shape)


def _straight(place: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places on the lines through those of the rows around."""
    row = np.arange(len(place))
    apart = row - row[:, None]
    kernel = np.exp(-np.square(apart / _ALONG) / 2) * weight
    sums = [(kernel * apart**power).sum(axis=1) for power in range(3)]
    first, second = kernel @ place, (kernel * apart) @ place
    determinant = sums[0] * sums[2] - sums[1] * sums[1] + 1e-9
    line: NDArray[np.float64] = (sums[2] * first - sums[1] * second) / determinant
    return line
