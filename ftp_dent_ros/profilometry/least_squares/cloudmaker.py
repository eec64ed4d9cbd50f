"""From the nodes back to the camera's pixels: an organised cloud."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.profilometry.least_squares.grid import Grid, Spreader
from ftp_dent_ros.profilometry.least_squares.sight import rays_at
from ftp_dent_ros.rig import Rig


# Pixel rows by which the camera's blur makes the surface look larger.
_BLURRED = 0.5
_LEAST_COVER = 0.3


class CloudMaker:
    """Makes clouds of inverse depths at the nodes.

    Inverse depth is what is interpolated: of a plane it is linear in the pixels.
    """

    def __init__(self, rig: Rig, grid: Grid, stride: int) -> None:
        self.grid, self.stride = grid, stride
        self._spreader = Spreader.of(grid, stride)
        columns = np.arange(0, grid.width, stride)
        rows = np.arange(0, grid.height, stride)
        self._rays = rays_at(rig.camera, columns, rows)
        self.clear()

    def clear(self) -> None:
        """Begin a new cloud."""
        shape = self._rays.shape[:2]
        self._points = np.full((*shape, 3), np.nan, np.float32)
        self._intensity = np.zeros(shape, np.float32)

    def add(
        self,
        inverse_depth: NDArray[np.float32],
        modulation: NDArray[np.float32],
        measured: NDArray[np.bool_],
        covered: NDArray[np.float32],
    ) -> None:
        """Add a surface.

        Parameters
        ----------
        inverse_depth, modulation : ndarray, shape (rows, columns), float32
            At the nodes.
        measured : ndarray, shape (rows, bins), bool
            Bins that are published.
        covered : ndarray, shape (rows, bins), float32
            Share of each bin that the surface covers.
        """
        grid, stride = self.grid, self.stride
        finite = np.isfinite(inverse_depth)
        filled = np.where(finite, inverse_depth, np.float32(1))
        depth = 1 / self._spreader.spread(filled)
        rows, columns = measured.shape
        size = columns * grid.step, rows * grid.pitch[1]
        rows_in = self._rows_in(measured, covered)
        mask = cv2.resize(rows_in, size, interpolation=cv2.INTER_NEAREST)
        mask = mask[: grid.height : stride, : grid.width : stride] > 0
        brightness = cv2.resize(modulation, size, interpolation=cv2.INTER_LINEAR)
        depth = depth[mask]
        self._points[mask, 0] = self._rays[mask, 0] * depth
        self._points[mask, 1] = self._rays[mask, 1] * depth
        self._points[mask, 2] = depth
        self._intensity[mask] = brightness[: grid.height : stride, : grid.width : stride][mask]

    def _rows_in(self, measured, covered) -> NDArray[np.uint8]:
        """Mask of the bins' rows of pixels: those beside measured bins are so as far as covered."""
        count = self.grid.pitch[1]
        mask = np.repeat(measured[:, None], count, axis=1)
        inner, outer = slice(1, None), slice(None, -1)
        for outside, inside, rows in (
            (outer, inner, range(count - 1, -1, -1)),  # the surface is below
            (inner, outer, range(count)),
        ):
            rim = measured[inside] & ~measured[outside]
            share = covered[outside] / np.maximum(covered[inside], _LEAST_COVER)
            seen = (count * share - _BLURRED) * rim
            for number, row in enumerate(rows, 1):
                mask[outside, row] |= seen >= number
        return mask.reshape(-1, measured.shape[1]).view(np.uint8)

    def cloud(self) -> Cloud:
        """The cloud."""
        return Cloud(self._points, self._intensity)
