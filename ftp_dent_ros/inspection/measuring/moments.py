"""Second moments of a set of cells, and the ellipse that has the same."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

# Variance of a place in a cell, in squares of its side.
_CELL = 1 / 12


class Moments(NamedTuple):
    """Of the places in some cells.

    Attributes
    ----------
    cells : int
        How many.
    column, row : float
        Mean.
    xx, yy, xy : float
        Variances along the columns and the rows, and covariance, in cells.
    """

    cells: int
    column: float
    row: float
    xx: float
    yy: float
    xy: float

    @classmethod
    def of(cls, mask: NDArray[np.bool_]) -> Moments:
        """Those of the cells of a mask, shape (rows, columns); of none, all 0."""
        sums = cv2.moments(mask.view(np.uint8), binaryImage=True)
        cells = round(sums['m00'])
        if not cells:
            return cls(0, 0.0, 0.0, 0.0, 0.0, 0.0)
        free = max(cells - 1, 1)
        return cls(
            cells,
            sums['m10'] / cells,
            sums['m01'] / cells,
            sums['mu20'] / free + _CELL,
            sums['mu02'] / free + _CELL,
            sums['mu11'] / free,
        )

    @property
    def angle(self) -> float:
        """From the columns' direction to the longer axis of the ellipse, in cells, radians."""
        return math.atan2(2 * self.xy, self.xx - self.yy) / 2

    def ellipse(self, across: float = 1.0, down: float = 1.0) -> tuple[float, float]:
        """Length and width of the ellipse with the same.

        Parameters
        ----------
        across, down : float
            From cell to cell along columns and rows, in the unit of the result.
        """
        xx, yy, xy = across**2 * self.xx, down**2 * self.yy, across * down * self.xy
        middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
        return 4 * math.sqrt(middle + half), 4 * math.sqrt(max(middle - half, 0.0))
