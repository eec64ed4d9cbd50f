"""The pixels of a lens, and a coarse grid of nodes to interpolate them from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ftp_dent_ros.rig.rig import Lens

# Between nodes, at most: pixels, and radians.
_NODE_SPACING = 16
_NODE_ANGLE = 0.01


@dataclass(frozen=True, eq=False)
class PixelGrid:
    """The pixels of a lens, and how to interpolate to them from a coarse grid of nodes.

    Attributes
    ----------
    rays : ndarray, shape (height, width, 3)
    node_rays : ndarray, shape (n, m, 3)
    rows, columns : scipy.sparse.csr_matrix, shape (height, n) and (width, m)
        ``rows @ nodes @ columns.T`` is the values at every pixel.
    vignette : ndarray, shape (height, width), float32
        The cos^4 law.
    """

    rays: NDArray[np.float64]
    node_rays: NDArray[np.float64]
    rows: csr_matrix
    columns: csr_matrix
    vignette: NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.rays.shape[0], self.rays.shape[1]

    def interpolated(self, nodes: NDArray) -> NDArray:
        """Values at every pixel, shape (height, width), of values at the nodes."""
        return self.rows.astype(nodes.dtype) @ (self.columns @ nodes.T).T.astype(nodes.dtype)

    def rays_within(
        self, pixels: NDArray[np.intp], along_u: NDArray, along_v: NDArray
    ) -> NDArray[np.float64]:
        """Rays through points within pixels.

        Parameters
        ----------
        pixels : ndarray, shape (n,)
            Flat indices.
        along_u, along_v : ndarray, shape (m,)
            Offsets from the pixels' centres.

        Returns
        -------
        ndarray, shape (n, m, 3)
        """
        row, column = np.divmod(pixels, self.shape[1])
        rays = self.rays[row, column][:, None]
        for offset, axis, index in ((along_u, 1, column), (along_v, 0, row)):
            after = np.minimum(index + 1, self.shape[axis] - 1)
            before = np.maximum(index - 1, 0)
            ends = (row, after, before) if axis else (column, after, before)
            higher = self.rays[ends[0], ends[1]] if axis else self.rays[ends[1], ends[0]]
            lower = self.rays[ends[0], ends[2]] if axis else self.rays[ends[2], ends[0]]
            slope = (higher - lower) / (after - before)[:, None]
            rays = rays + slope[:, None] * offset[:, None]
        return rays


@lru_cache(maxsize=4)
def pixel_grid(lens: Lens) -> PixelGrid:
    """Grid of a lens; the last few lenses' are kept."""
    u, columns = _interpolation(lens.width, lens.camera_matrix[0, 0])
    v, rows = _interpolation(lens.height, lens.camera_matrix[1, 1])
    node_rays = lens.rays(np.stack(np.meshgrid(u, v), axis=-1))
    rays = np.stack([rows @ node_rays[..., i] @ columns.T for i in range(3)], axis=-1)
    vignette = 1 / np.sum(rays * rays, axis=-1) ** 2
    return PixelGrid(rays, node_rays, rows, columns, vignette.astype(np.float32))


def _interpolation(size: int, focal: float) -> tuple[NDArray[np.float64], csr_matrix]:
    """Nodes over 0 ... size - 1, and the matrix of Lagrange's cubic from them to each pixel."""
    spacing = min(_NODE_SPACING, _NODE_ANGLE * focal)
    count = max(4, min(math.ceil((size - 1) / spacing) + 1, size))
    nodes = np.linspace(0, size - 1, count)
    position = np.arange(size) / max(size - 1, 1) * (count - 1)
    first = np.clip(np.floor(position).astype(int) - 1, 0, count - 4)
    t = position - first
    weights = np.zeros((size, count))
    for k in range(4):
        others = [j for j in range(4) if j != k]
        weight = np.prod([(t - j) / (k - j) for j in others], axis=0)
        weights[np.arange(size), first + k] = weight
    return nodes, csr_matrix(weights)
