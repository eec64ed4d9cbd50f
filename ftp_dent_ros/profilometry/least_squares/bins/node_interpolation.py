"""From the nodes to the pixels: Lagrange's interpolation, a band of a matrix at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid

# Nodes that a value is interpolated from: fewer leave ripples of the nodes inside dents; and
# those that one beyond the outermost is extrapolated from: more multiply their noise.
_TAPS, _BEYOND = 6, 3
# Columns, and rows that stay in the cache, that one product makes.
_COLUMNS, _ROWS = 64, 32

Band = tuple[slice, slice, NDArray[np.float32]]


def lagrange(targets: NDArray[np.floating], count: int) -> NDArray[np.float64]:
    """Weights of Lagrange's interpolation through the nearest of `count` nodes 0, 1, 2, ...

    Parameters
    ----------
    targets : ndarray, shape (targets,)

    Returns
    -------
    ndarray, shape (targets, count)
    """
    weights = np.zeros((len(targets), count))
    beyond = (targets < 0) | (targets > count - 1)
    for taps, chosen in ((_TAPS, ~beyond), (_BEYOND, beyond)):
        taps, index = min(taps, count), np.flatnonzero(chosen)
        target = targets[index]
        first = np.clip(np.floor(target).astype(int) - taps // 2 + 1, 0, count - taps)
        t = target - first
        for k in range(taps):
            factors = [(t - j) / (k - j) for j in range(taps) if j != k]
            weights[index, first + k] = np.prod(factors, axis=0)
    return weights


@dataclass(frozen=True, eq=False)
class NodeInterpolation:
    """Interpolates from nodes to every `stride`-th pixel.

    Attributes
    ----------
    columns : tuple
        For each block: its pixels, the nodes that they need, and the weights.
    rows : tuple
        Such blocks.
    wide : ndarray, shape (rows of nodes, columns of pixels), float32
        Workspace.
    """

    columns: tuple[Band, ...]
    rows: tuple[Band, ...]
    wide: NDArray[np.float32]

    @classmethod
    def of(cls, grid: Grid, stride: int) -> NodeInterpolation:
        """NodeInterpolation to a cloud's grid."""
        columns, rows = (
            (np.arange(0, size, stride) - (pitch - 1) / 2) / pitch
            for size, pitch in zip((grid.width, grid.height), grid.pitch, strict=True)
        )
        along_u = tuple(
            (targets, nodes, np.ascontiguousarray(weights.T))
            for targets, nodes, weights in _bands(columns, grid.shape[1], _COLUMNS)
        )
        along_v = tuple(_bands(rows, grid.shape[0], _ROWS))
        return cls(along_u, along_v, np.empty((grid.shape[0], len(columns)), np.float32))

    def widened(self, nodes: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values interpolated along u, in the workspace."""
        for targets, needed, weights in self.columns:
            np.matmul(nodes[:, needed], weights, out=self.wide[:, targets])
        return self.wide


def _bands(targets, count, size):
    for first in range(0, len(targets), size):
        block = slice(first, min(first + size, len(targets)))
        weights = lagrange(targets[block], count)
        used = np.flatnonzero(weights.any(axis=0))
        nodes = slice(int(used[0]), int(used[-1]) + 1)
        yield block, nodes, np.ascontiguousarray(weights[:, nodes], np.float32)
