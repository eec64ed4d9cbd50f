"""Normal equations of poses by least squares, six unknowns each, sparse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix


class NormalEquations:
    """Normal equations, block by block; poses before the first are fixed.

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
        self.fixed, self._count = fixed, count
        self.gradient = np.zeros(6 * count)
        self._blocks: dict[tuple[int, int], NDArray[np.float64]] = {}

    def add(
        self,
        poses: list[int],
        moves: list[NDArray[np.float64]],
        error: NDArray[np.float64],
        information: NDArray[np.floating],
    ) -> None:
        """Add an error of some poses, how it changes with each of them, and what it weighs.

        Parameters
        ----------
        poses : list of int
        moves : list of ndarray, shape (6, 6)
            Change of the error with a small shift and turn of each.
        error : ndarray, shape (6,)
        information : ndarray, shape (6, 6)
            Inverse of the error's covariance.
        """
        free = [(p - self.fixed, m) for p, m in zip(poses, moves, strict=True) if p >= self.fixed]
        for i, move in free:
            held = move.T @ information
            self.gradient[6 * i : 6 * i + 6] += held @ error
            for j, other in free:
                block = held @ other
                known = self._blocks.get((i, j))
                self._blocks[i, j] = block if known is None else known + block

    def matrix(self) -> csc_matrix:
        """Matrix of the equations, shape (6 count, 6 count)."""
        size = 6 * self._count
        if not self._blocks:
            return csc_matrix((size, size))
        places = np.array(list(self._blocks))
        values = np.stack(list(self._blocks.values()))
        inside = np.arange(6)
        rows = np.broadcast_to(6 * places[:, 0, None, None] + inside[:, None], values.shape)
        columns = np.broadcast_to(6 * places[:, 1, None, None] + inside, values.shape)
        entries = (values.ravel(), (rows.ravel(), columns.ravel()))
        return coo_matrix(entries, shape=(size, size)).tocsc()
