"""The projector's rows, as blocks of the photograph show them.

Amplitude over level is free of paint, dirt and shading. In each block its logarithm is fitted by
``quadric + a cos(2 pi v / P) - b sin(2 pi v / P)`` with the row v by the epipolar line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern

# Blocks: periods along v, and projector pixels along u; every how many columns of nodes, which
# lie closer than what they see.
_PERIODS, _COLUMNS, _EVERY = 2.0, 128.0, 2
# Share of a whole block from which on it is used; fewest blocks.
_LEAST_SHARE, _FEWEST = 0.7, 6
# Nodes of the fewest that tell anything about eight unknowns.
_LEAST_NODES = 60


@dataclass(frozen=True, eq=False)
class Rows:
    """What one surface shows of the projector's rows, at the nodes of a grid.

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


def blocks_of(pattern: Pattern, surfaces: Sequence[Rows]) -> Blocks | None:
    """Waves of the rows in all blocks of the image that are seen well enough."""
    shape = surfaces[0].seen.shape
    u_p, v_p, contrast = (np.zeros(shape, np.float32) for _ in range(3))
    seen = np.zeros(shape, bool)
    for rows in surfaces:
        more = rows.seen & np.isfinite(rows.v_p) & (rows.contrast > 0)
        for whole, part in ((u_p, rows.u_p), (v_p, rows.v_p), (contrast, rows.contrast)):
            np.copyto(whole, part, where=more, casting='same_kind')
        seen |= more
    size = _block_size(pattern, u_p, v_p, seen)
    if size is None:
        return None
    tiles = [_tiles(each, size) for each in (u_p, v_p, contrast, seen.astype(np.float32))]
    rays = np.stack([_tiles(surfaces[0].rays[..., axis], size) for axis in (0, 1)], axis=-1)
    count = tiles[3].sum(axis=1)
    held = count >= max(_LEAST_SHARE * size[0] * size[1], _LEAST_NODES)
    if np.count_nonzero(held) < _FEWEST:
        return None
    u, v, contrast, weight = (each[held] for each in tiles)
    level = np.log(np.where(weight > 0, contrast, 1))
    wave, left = _waves(pattern, size, v, level, weight)
    count = count[held].astype(float)
    middle_u, middle_v = ((weight * each).sum(axis=1) / count for each in (u, v))
    middle = (weight[..., None] * rays[held]).sum(axis=1) / count[:, None]
    place = np.stack(np.divmod(np.flatnonzero(held), -(-shape[1] // _EVERY // size[1])), axis=-1)
    certain = count / (left + np.median(left))
    return Blocks(middle_u, middle_v, wave, certain, middle, place)


def _waves(
    pattern: Pattern, size: Sequence[int], v: NDArray, level: NDArray, weight: NDArray
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Least squares of ``quadric + a cos(2 pi v / P) - b sin(2 pi v / P)``.

    Returns
    -------
    wave : ndarray, shape (n,), complex
        a + i b by block.
    left : ndarray, shape (n,)
        Mean square of what it leaves.
    """
    angle = np.float32(2 * math.pi / pattern.row_period_px) * v
    y, x = (
        each.ravel() for each in np.meshgrid(*(np.linspace(-1, 1, n) for n in size), indexing='ij')
    )
    quadric = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    terms = np.concatenate(
        [
            np.broadcast_to(quadric.astype(np.float32), (*angle.shape, 6)),
            np.stack([np.cos(angle), -np.sin(angle)], axis=-1),
        ],
        axis=-1,
    )
    weighted = (terms * weight[..., None]).transpose(0, 2, 1)
    normal = (weighted @ terms).astype(float)
    found = np.linalg.solve(normal, (weighted @ level[..., None]).astype(float))[..., 0]
    rest = level - (terms @ found[..., None])[..., 0]
    left = (weight * np.square(rest)).sum(axis=1) / weight.sum(axis=1)
    return found[:, 6] + 1j * found[:, 7], left


def _block_size(pattern: Pattern, u_p: NDArray, v_p: NDArray, seen: NDArray) -> list[int] | None:
    """Rows and columns of nodes, of every other column, that are a block."""
    sizes = []
    for length, field, axis in (
        (_PERIODS * pattern.row_period_px, v_p, 0),
        (_COLUMNS, u_p, 1),
    ):
        both = seen[1:] & seen[:-1] if axis == 0 else seen[:, 1:] & seen[:, :-1]
        if np.count_nonzero(both) < _LEAST_NODES:
            return None
        step = abs(float(np.mean(np.diff(field, axis=axis)[both])))
        sizes.append(max(round(length / max(step, 1e-3) / (1, _EVERY)[axis]), 2))
    return sizes


def _tiles(field: NDArray, size: Sequence[int]) -> NDArray:
    """Blocks of every other column, shape (blocks, nodes), filled up with zeros."""
    some = field[:, ::_EVERY]
    down, across = (-(-length // n) for length, n in zip(some.shape, size, strict=True))
    whole = np.zeros((down * size[0], across * size[1]), field.dtype)
    whole[: some.shape[0], : some.shape[1]] = some
    tiles = whole.reshape(down, size[0], across, size[1]).swapaxes(1, 2)
    return tiles.reshape(down * across, -1)
