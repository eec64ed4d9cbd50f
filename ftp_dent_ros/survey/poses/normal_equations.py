"""Normal equations of poses by least squares, six unknowns each, sparse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix

Array = NDArray[np.float64]


def squares(errors: Array, information: Array) -> Array:
    """Squares of errors, in standard deviations, shape (n,).

    Parameters
    ----------
    errors : ndarray, shape (n, 6)
    information : ndarray, shape (n, 6, 6)
        Inverses of the errors' covariances.
    """
    return (errors * (information @ errors[..., None])[..., 0]).sum(axis=1)


class NormalEquations:
    """Normal equations, gathered from terms; poses before the first are fixed.

    Parameters
    ----------
    fixed : int
        Number of the first pose that moves.
    count : int
        Poses that move.

    Attributes
    ----------
    gradient : ndarray, shape (6 count,)
    """

    def __init__(self, fixed: int, count: int) -> None:
        self._fixed, self._count = fixed, count
        self.gradient = np.zeros(6 * count)
        self._rows: list[NDArray[np.intp]] = []
        self._columns: list[NDArray[np.intp]] = []
        self._blocks: list[Array] = []

    def add(
        self,
        poses: Sequence[NDArray[np.intp]],
        moves: Sequence[Array],
        errors: Array,
        information: Array,
    ) -> None:
        """Add errors of some poses, how they change with each of them, and what they weigh.

        Parameters
        ----------
        poses : sequence of ndarray, shape (n,)
            Numbers of the first pose, of the second, and so on, of each of n errors.
        moves : sequence of ndarray, shape (n, 6, 6)
            Change of the errors with a small shift and turn of each.
        errors : ndarray, shape (n, 6)
        information : ndarray, shape (n, 6, 6)
            Inverses of the errors' covariances.
        """
        gradient = self.gradient.reshape(-1, 6)
        for pose, move in zip(poses, moves, strict=True):
            free = pose >= self._fixed
            held = np.swapaxes(move, 1, 2) @ information
            np.add.at(gradient, pose[free] - self._fixed, (held @ errors[..., None])[free][..., 0])
            for other, change in zip(poses, moves, strict=True):
                both = free & (other >= self._fixed)
                self._rows.append(pose[both] - self._fixed)
                self._columns.append(other[both] - self._fixed)
                self._blocks.append(held[both] @ change[both])

    def matrix(self) -> csc_matrix:
        """Matrix of the equations, shape (6 count, 6 count)."""
        size = 6 * self._count
        # Half the memory of whole words, of which there are 72 a block.
        rows, columns = (
            np.concatenate(each).astype(np.int32) for each in (self._rows, self._columns)
        )
        blocks = np.concatenate(self._blocks)
        inside = np.arange(6, dtype=np.int32)
        at = np.broadcast_to(6 * rows[:, None, None] + inside[:, None], blocks.shape)
        beside = np.broadcast_to(6 * columns[:, None, None] + inside, blocks.shape)
        entries = (blocks.ravel(), (at.ravel(), beside.ravel()))
        return coo_matrix(entries, shape=(size, size)).tocsc()
