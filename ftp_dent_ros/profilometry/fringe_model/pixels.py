"""From surfaces of points at bins and nodes to the cloud at the camera's pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid
from ftp_dent_ros.profilometry.fringe_model.quadric import Quadric
from ftp_dent_ros.profilometry.fringe_model.solver import RESOLVED
from ftp_dent_ros.profilometry.phase_geometry import rays_at
from ftp_dent_ros.rig.rig import Rig

# Standard deviation of a point over its distance, beyond which it is none.
_FAR = 0.1
#: Share of the light that is there at the rim, which the lens blurs.
SHARE = 0.75
#: Projector pixels at the panel's rim that the lens blurs.
RIM = 1.5
# Rows of the cloud whose planes stay in the cache.
_STRIP = 32


@dataclass(frozen=True, eq=False)
class Sheet:
    """A surface of points.

    Attributes
    ----------
    quadric : Quadric
    away, raw : ndarray, shape (rows, columns), float32
        Inverse depth about the quadric's, at the bins, denoised and before.
    deviation, noise : ndarray, shape (rows, nodes), float32
        Standard deviations of both along the rays, metres.
    amplitude : ndarray, shape (rows, nodes), float32
        Of the fringes, grey levels.
    share : ndarray, shape (rows, nodes), float32
        Of the surface's light that is there.
    sure, good : ndarray of bool, shape (rows, nodes)
        Nodes inside the surface, and those that may have points.
    rim : ndarray, shape (rows, nodes), float32
        Projector pixels from the panel's nearest rim.
    """

    quadric: Quadric
    away: NDArray[np.float32]
    raw: NDArray[np.float32]
    deviation: NDArray[np.float32]
    noise: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    share: NDArray[np.float32]
    sure: NDArray[np.bool_]
    good: NDArray[np.bool_]
    rim: NDArray[np.float32]


class Pixels:
    """The pixels of the cloud, with their rays.

    Parameters
    ----------
    rig : Rig
    grid : BinGrid
    stride : int
        The cloud has every `stride`-th pixel.
    """

    def __init__(self, rig: Rig, grid: BinGrid, stride: int) -> None:
        self._grid, self._stride = grid, stride
        self._columns, self._rows = (np.arange(0, n, stride) for n in (grid.width, grid.height))
        self._rays = rays_at(rig.camera, self._columns, self._rows)
        self._length = np.sqrt(1 + np.square(self._rays).sum(axis=-1))
        self._resolution = np.float32(RESOLVED * grid.period / rig.camera.camera_matrix[0, 0])

    def cloud(self, sheets: Sequence[Sheet]) -> Cloud:
        """Cloud of surfaces; the later ones lie over the others."""
        shape = self._rays.shape[:2]
        unknown = (np.full(shape, np.nan, np.float32) for _ in range(4))
        points = np.full((*shape, 3), np.nan, np.float32)
        cloud = Cloud(points, np.zeros(shape, np.float32), *unknown)
        for sheet in sheets:
            # Four planes at once take as long as one.
            nodes = np.stack(
                (sheet.deviation, sheet.noise, sheet.amplitude, sheet.rim), -1, dtype=np.float32
            )
            for first in range(0, len(self._rows), _STRIP):
                self._put(cloud, sheet, nodes, slice(first, first + _STRIP))
        return cloud

    def _put(self, cloud: Cloud, sheet: Sheet, nodes, rows: slice) -> None:
        """Put a strip of a surface into the cloud."""
        good = self._at(sheet.good, rows, cv2.INTER_NEAREST) > 0
        if not good.any():
            return
        places = self._grid.places(self._columns, self._rows[rows])
        smooth = sheet.quadric.at(*places)
        z, raw = (1 / (smooth + self._at(each, rows)) for each in (sheet.away, sheet.raw))
        sigma, noise, amplitude, rim = cv2.split(self._at(nodes, rows))
        on = good & (z > 0) & (sigma < _FAR * z) & (rim > RIM)
        sure = self._at(sheet.sure, rows, cv2.INTER_NEAREST) > 0
        on &= sure | (self._at(sheet.share, rows) > SHARE)
        x, y = self._rays[rows, :, 0], self._rays[rows, :, 1]
        for field, values in (
            *((cloud.points[rows, :, i], each) for i, each in enumerate((x * z, y * z, z))),
            (cloud.intensity[rows], amplitude),
            (cloud.sigma[rows], sigma),
            (cloud.resolution[rows], self._resolution * z),
            (cloud.raw[rows], (raw - z) * self._length[rows]),
            (cloud.noise[rows], noise),
        ):
            np.copyto(field, values, where=on)

    def _at(self, values, rows: slice, how=cv2.INTER_LINEAR):
        """Values of the bins or of the nodes at the pixels of some rows."""
        grid, first = self._grid, self._rows[rows][0]
        wide = grid.step if values.shape[:2] == grid.shape else grid.step * grid.node
        scale = np.array([[self._stride / wide, 0, 0], [0, self._stride / grid.rows, 0]])
        scale[:, 2] = 0.5 / wide - 0.5, (first + 0.5) / grid.rows - 0.5  # of the first pixel
        return cv2.warpAffine(
            values.view(np.uint8) if values.dtype == bool else values,
            scale,
            (len(self._columns), len(self._rows[rows])),
            flags=how | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
