"""The rim of the projector's frame: a second absolute mark, where it is in view.

A step of whole fringes cannot be seen in the fringes. But where a surface is lit up to the rim of
the frame, that rim is then seen whole fringes away from where the projector has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.robust import median

# Row of nodes that is looked at.
_EVERY = 2
# Fringes: what a surface's rim lacks of the frame's, how far the rows may differ from one
# another, and the rim from whole fringes; and beyond how many it is taken for the object's rim.
_LACK, _SPREAD, _WHOLE = 0.4, 0.12, 0.25
_MOST = 20
# Rows that must agree, and the fringes beside the image's border that tell nothing.
_LEAST_ROWS = 6
# Nodes from an end to the surface that it ends.
_INWARDS = 16
_BORDER = 2.0


@dataclass(frozen=True)
class FrameRim:
    """Left and right ends of the rows of a surface, in reading order; all of shape (ends,).

    Attributes
    ----------
    row, column : ndarray
        Nodes.
    right : ndarray
        0 for left ends, 1 for right ones.
    away : ndarray
        Fringes between the end and the rim of the projector's frame.
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    right: NDArray[np.intp]
    away: NDArray[np.floating]

    @classmethod
    def of(
        cls, measured: NDArray[np.bool_], phase: NDArray[np.float32], pattern: Pattern, grid: Grid
    ) -> FrameRim:
        """Rim of a surface.

        Parameters
        ----------
        measured : ndarray, shape (rows, bins), bool
            Bins on the surface.
        phase : ndarray, shape (rows, columns), float32
            Absolute phase at the nodes, radians.
        """
        rows = np.arange(1, len(phase), _EVERY)
        body, fringes = measured[rows], phase[rows] / np.float32(2 * np.pi)
        count, each = body.shape[1], np.arange(len(rows))
        first, last = (
            (u - pattern.stripe_center_px) / pattern.period_px for u in (-0.5, pattern.width - 0.5)
        )
        found = []
        for right in (0, 1):
            end = count - 1 - body[:, ::-1].argmax(axis=1) if right else body.argmax(axis=1)
            position = (end + 0.5) / grid.bins - 0.5
            node = np.clip(position.astype(np.intp), 0, phase.shape[1] - 2)
            slope = fringes[each, node + 1] - fringes[each, node]
            order = fringes[each, node] + slope * (position - node)
            border = _BORDER * grid.bins / np.maximum(np.abs(slope), 1e-3)
            seen = body.any(axis=1) & (end > border) & (end < count - 1 - border)
            outwards = slope if right else -slope
            away = np.where(outwards > 0, last - order, order - first)[seen]
            found.append((rows[seen], end[seen] // grid.bins, np.full(len(away), right), away))
        return cls(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def blocks(self) -> NDArray[np.intp]:
        """A label for the ends of some rows that follow one another."""
        return 1 + self.row // (_EVERY * 2 * _LEAST_ROWS)

    def beside(self, labels: NDArray[np.integer]) -> NDArray[np.integer]:
        """Label of the surface at each end, or a little way inwards of it.

        Parameters
        ----------
        labels : ndarray, shape (rows, columns), integer
            0 for none.
        """
        found = labels[self.row, self.column]
        inwards = 1 - 2 * self.right
        for step in range(1, _INWARDS):
            column = np.clip(self.column + step * inwards, 0, labels.shape[1] - 1)
            found = np.where(found == 0, labels[self.row, column], found)
        return found

    def off(self, labels: NDArray[np.integer]) -> list[int]:
        """Labels of the ends that together lie whole fringes off the rim of the frame.

        Parameters
        ----------
        labels : ndarray, shape (ends,), integer
            0 for none.
        """
        found = []
        for label in np.unique(labels[labels > 0]):
            for right in (0, 1):
                away = self.away[(labels == label) & (self.right == right)] - _LACK
                if len(away) < _LEAST_ROWS:
                    continue
                middle = median(away)
                turns = round(middle)
                parallel = median(np.abs(away - middle)) < _SPREAD
                if 0 < abs(turns) <= _MOST and parallel and abs(middle - turns) < _WHOLE:
                    found.append(int(label))
                    break
        return found
