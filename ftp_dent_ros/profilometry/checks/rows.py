"""The projector's rows, as blocks of the photograph show them.

Amplitude over level is free of paint, dirt and shading. In each block its logarithm is fitted by
``quadric + a cos(2 pi v / P) - b sin(2 pi v / P)`` with the row v by the epipolar line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.robust import median

#: Periods of the rows that a block is long along u and v.
PERIODS = 2


@dataclass(frozen=True, eq=False)
class Rows:
    """What surfaces show of the projector's rows, at the nodes of a grid.

    Attributes
    ----------
    u_p, v_p : ndarray, shape (rows, columns)
        Projector column by the fringes, and row by the epipolar line.
    contrast : ndarray, shape (rows, columns)
        Amplitude of the fringes over their level, without the code's own contrast.
    seen : ndarray, shape (rows, columns), bool
        Nodes that are measured, and away from rims.
    rays : ndarray, shape (rows, columns, 2)
        x and y of the camera's rays with z = 1.
    """

    u_p: NDArray[np.floating]
    v_p: NDArray[np.floating]
    contrast: NDArray[np.floating]
    seen: NDArray[np.bool_]
    rays: NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of nodes.

    Attributes
    ----------
    u, v : ndarray, shape (n,)
        Their middles, projector pixels, v by the epipolar lines.
    wave : ndarray, shape (n,), complex
        Wave of the contrast's logarithm along v: its argument is 2 pi over the period times how
        far the light's row is beyond v.
    weight : ndarray, shape (n,)
        Nodes over the variance of what the wave leaves of a block and of what it leaves of most:
        what is dark, or has an edge of other light in it, tells less.
    rays : ndarray, shape (n, 2)
        x and y of the camera's rays through the middles, z = 1.
    place : ndarray, shape (n, 2), integer
        Row and column of blocks.
    """

    u: NDArray[np.float64]
    v: NDArray[np.float64]
    wave: NDArray[np.complex128]
    weight: NDArray[np.float64]
    rays: NDArray[np.float64]
    place: NDArray[np.intp]


def blocks_of(pattern: Pattern, rows: Rows) -> Blocks:
    """Waves of the rows in all blocks of the image that are seen well enough."""
    seen = rows.seen & np.isfinite(rows.v_p) & (rows.contrast > 0)
    length = PERIODS * pattern.row_period_px
    size = _nodes(length, rows.v_p, seen), _nodes(length, rows.u_p.T, seen.T)
    level = np.log(np.where(seen, rows.contrast, 1))
    fields = rows.u_p, rows.v_p, rows.rays[..., 0], rows.rays[..., 1], level
    weight = _tiles(seen.astype(np.float32), size)
    held = 2 * weight.sum(axis=1) > math.prod(size)  # most of a block tells its eight unknowns
    weight = weight[held]
    tiles = [_tiles(np.where(seen, each, 0), size)[held] for each in fields]
    wave, left = _waves(pattern, size, tiles[1], tiles[-1], weight)
    count = weight.sum(axis=1)
    u, v, x, y = (each.sum(axis=1) / count for each in tiles[:-1])
    place = np.divmod(np.flatnonzero(held), -(-seen.shape[1] // size[1]))
    certain = count / (left + median(left))
    return Blocks(u, v, wave, certain, np.stack([x, y], axis=-1), np.stack(place, axis=-1))


def _waves(
    pattern: Pattern, size: tuple[int, int], v: NDArray, level: NDArray, weight: NDArray
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Least squares of ``quadric + a cos(2 pi v / P) - b sin(2 pi v / P)``.

    Returns
    -------
    wave : ndarray, shape (n,), complex
        a + i b by block.
    left : ndarray, shape (n,)
        Mean square of what it leaves.
    """
    turn = 2 * math.pi / pattern.row_period_px * v
    y, x = (each.ravel() for each in np.mgrid[-1 : 1 : size[0] * 1j, -1 : 1 : size[1] * 1j])
    quadric = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    both = np.stack([np.cos(turn), -np.sin(turn)], axis=-1)
    terms = np.concatenate([np.broadcast_to(quadric, (*v.shape, 6)), both], axis=-1)
    weighted = (terms * weight[..., None]).transpose(0, 2, 1)
    # Blocks of few nodes do not tell all of them.
    found = np.linalg.pinv(weighted @ terms, hermitian=True) @ (weighted @ level[..., None])
    left = np.square(level[..., None] - terms @ found)[..., 0]
    return found[:, -2:, 0] @ [1, 1j], (weight * left).sum(axis=1) / weight.sum(axis=1)


def _nodes(length: float, field: NDArray, seen: NDArray[np.bool_]) -> int:
    """Nodes, from row to row, over which a field changes by a length."""
    steps = np.diff(field, axis=0)[seen[1:] & seen[:-1]]
    step = abs(float(steps.mean())) if steps.size else 0.0
    return max(round(length / max(step, length / len(field))), 2)


def _tiles(field: NDArray, size: tuple[int, int]) -> NDArray:
    """Blocks, shape (blocks, nodes), filled up with zeros."""
    beyond = [(0, -length % n) for length, n in zip(field.shape, size, strict=True)]
    whole = np.pad(field, beyond)
    down, across = (length // n for length, n in zip(whole.shape, size, strict=True))
    tiles = whole.reshape(down, size[0], across, size[1]).swapaxes(1, 2)
    return tiles.reshape(down * across, -1)
