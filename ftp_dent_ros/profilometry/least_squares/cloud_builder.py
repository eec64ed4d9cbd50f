"""From the nodes back to the camera's pixels: an organised cloud."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.node_interpolation import NodeInterpolation
from ftp_dent_ros.profilometry.phase_geometry import rays_at
from ftp_dent_ros.rig.rig import Rig

# Pixel rows by which the camera's blur makes the surface look larger.
_BLURRED = 0.75
_LEAST_COVER = 0.3
# Share of a bin at the rim from which on it counts as covered.
_WHOLE = 0.98
_INSIDE = np.uint8(255)
# A bin and those beside it.
_BIN = np.ones((3, 3), np.uint8)


class CloudBuilder:
    """Makes clouds of inverse depths at the nodes.

    Inverse depth is what is interpolated: of a plane it is linear in the pixels.

    Parameters
    ----------
    rig : Rig
    grid : Grid
    stride : int
        The cloud has every `stride`-th pixel, along rows and columns.
    """

    def __init__(self, rig: Rig, grid: Grid, stride: int) -> None:
        self.grid, self.stride = grid, stride
        self._interpolation = NodeInterpolation.of(grid, stride)
        rays = rays_at(
            rig.camera, np.arange(0, grid.width, stride), np.arange(0, grid.height, stride)
        )
        self._x, self._y = (np.ascontiguousarray(rays[..., axis]) for axis in (0, 1))
        strip = max(len(weights) for *_, weights in self._interpolation.rows)
        self._work = np.empty((3, strip, self._x.shape[1]), np.float32)
        self._nothing = np.full((strip, self._x.shape[1]), np.nan, np.float32)
        self._zero = np.zeros_like(self._nothing)
        self._focal = float(rig.camera.camera_matrix[0, 0])

    def cloud(self, surfaces: list[Published]) -> Cloud:
        """Cloud of surfaces, the later ones over the earlier."""
        cloud = self._of(surfaces[0])
        for surface in surfaces[1:]:
            more = self._of(surface)
            seen = more.valid
            for name in ('points', 'intensity', 'sigma', 'resolution'):
                getattr(cloud, name)[seen] = getattr(more, name)[seen]
        # What may lie a tenth of its depth elsewhere is no measured point.
        vague = cloud.sigma > np.float32(0.1) * cloud.points[..., 2]
        cloud.points[vague], cloud.sigma[vague], cloud.intensity[vague] = np.nan, np.nan, 0
        return cloud

    def _of(self, surface: Published) -> Cloud:
        shape = self._x.shape
        cloud = Cloud(
            np.empty((*shape, 3), np.float32),
            *(np.empty(shape, np.float32) for _ in ('intensity', 'sigma', 'resolution')),
        )
        self._fill(surface, cloud)
        return cloud

    def _fill(self, surface: Published, cloud: Cloud) -> None:
        grid, stride = self.grid, self.stride
        wide = self._interpolation.widened(surface.inverse_depth)
        mask = _rows_in(surface, grid.pitch[1])
        self._interpolate(surface.modulation, cloud.intensity)
        self._interpolate(surface.deviation, cloud.sigma)
        self._interpolate(surface.wavelength / self._focal, cloud.resolution)
        for rows, nodes, weights in self._interpolation.rows:
            x, y, z = self._work[:, : len(weights)]
            np.matmul(weights, wide[nodes], out=z)
            np.divide(np.float32(1), z, out=z)
            part = mask[rows.start * stride : (rows.stop - 1) * stride + 1 : stride]
            if not part.all():
                # Masked copies of OpenCV's are several times as fast as NumPy's.
                outside = cv2.bitwise_not(self._of_pixels(part))
                nothing = self._nothing[: len(z)]
                cv2.copyTo(self._zero[: len(z)], outside, cloud.intensity[rows])
                cv2.copyTo(nothing, outside, cloud.sigma[rows])
                cv2.copyTo(nothing, outside, z)
            cloud.resolution[rows] *= z
            np.multiply(self._x[rows], z, out=x)
            np.multiply(self._y[rows], z, out=y)
            cv2.merge([x, y, z], dst=cloud.points[rows])

    def _interpolate(self, nodes: NDArray[np.float32], pixels: NDArray[np.float32]) -> None:
        """Values at the nodes to the cloud's pixels, linearly."""
        grid, stride = self.grid, self.stride
        # Of all pixels that nodes are for, the cloud may not have each.
        width, height = (
            count * pitch for count, pitch in zip(grid.shape[::-1], grid.pitch, strict=True)
        )
        if (height, width) == pixels.shape:
            cv2.resize(nodes, (width, height), dst=pixels, interpolation=cv2.INTER_LINEAR)
            return
        wide = cv2.resize(nodes, (width, len(nodes)), interpolation=cv2.INTER_LINEAR)
        wide = np.ascontiguousarray(wide[:, : grid.width : stride])
        high = cv2.resize(wide, (wide.shape[1], height), interpolation=cv2.INTER_LINEAR)
        np.copyto(pixels, high[: grid.height : stride])

    def _of_pixels(self, bins):
        """Mask of the bins at the cloud's columns."""
        step, stride = self.grid.step, self.stride
        if stride % step == 0:
            return bins[:, :: stride // step][:, : self._x.shape[1]]
        if step == 2:
            # Each byte twice.
            twice = np.multiply(bins, np.uint16(257), dtype=np.uint16).view(np.uint8)
            return twice[:, : self.grid.width : stride]
        size = bins.shape[1] * step, len(bins)
        wide: Any = cv2.resize(bins, size, interpolation=cv2.INTER_NEAREST)
        return wide[:, : self.grid.width : stride]


@dataclass(frozen=True, eq=False)
class Published:
    """A surface to make a cloud of.

    Attributes
    ----------
    inverse_depth, modulation, deviation : ndarray, shape (rows, columns), float32
        At the nodes, finite; the deviation is the standard uncertainty along the ray, metres.
    wavelength : ndarray, shape (rows, columns), float32
        At which half of a detail's depth is left, pixels.
    measured : ndarray, shape (rows, bins), bool
        Bins that are published.
    covered : ndarray, shape (rows, bins), float32
        Share of each bin that the surface covers.
    """

    inverse_depth: NDArray[np.float32]
    modulation: NDArray[np.float32]
    deviation: NDArray[np.float32]
    wavelength: NDArray[np.float32]
    measured: NDArray[np.bool_]
    covered: NDArray[np.float32]


def near(bins: NDArray[np.bool_], reach: tuple[int, int]) -> NDArray[np.bool_]:
    """Bins so near to those of a mask, bins along v and u."""
    if not bins.any():
        return bins
    size = [2 * each + 1 for each in reach]
    return cv2.dilate(bins.view(np.uint8), np.ones(size, np.uint8)) > 0


def parted(
    surfaces: list[Published], doubted: list[NDArray[np.bool_]], reach: tuple[int, int]
) -> list[Published]:
    """The surfaces without their outermost bins that are doubted, or that another is near.

    The fringes tell where one surface ends and the other begins to a bin; what a pixel there
    shows may be of either.

    Parameters
    ----------
    surfaces : list of Published
    doubted : list of ndarray, shape (rows, bins), bool
        Bins of each that may be of a surface that is not published.
    reach : (int, int)
        How near the other is, bins along v and u.
    """
    count = np.sum([each.measured for each in surfaces], axis=0, dtype=np.uint8)
    result = []
    for each, either in zip(surfaces, doubted, strict=True):
        meeting = either | near(count > each.measured, reach)
        if meeting.any():
            measured: Any = each.measured.view(np.uint8)
            meeting = meeting & (cv2.erode(measured, _BIN, borderValue=1) == 0)
            covered = np.where(meeting, np.float32(0), each.covered)
            each = replace(each, measured=each.measured & ~meeting, covered=covered)
        result.append(each)
    return result


def _rows_in(surface: Published, count: int) -> NDArray[np.uint8]:
    """Mask, 255 inside, of the bins' rows of pixels: at the rim they are in as far as covered."""
    measured, covered = surface.measured, surface.covered
    bins, columns = measured.shape
    wide = np.repeat(measured.view(np.uint8) * _INSIDE, count, axis=0)
    mask = wide.reshape(bins, count, columns)
    rim = np.flatnonzero(measured[1:] != measured[:-1])
    below = measured.ravel()[rim + columns]
    away = np.arange(count)[:, None]
    for surface_below in (True, False):
        row, column = np.divmod(rim[below == surface_below], columns)
        inside, outside = row + surface_below, row + (not surface_below)
        at_rim = covered[inside, column]
        seen = count * covered[outside, column] / np.maximum(at_rim, _LEAST_COVER) - _BLURRED
        lacking = np.where(seen < 1, count * (_WHOLE - at_rim), 0)
        pixel = count - 1 - away if surface_below else away
        mask[outside, pixel, column] |= (seen >= away + 1) * _INSIDE
        mask[inside, count - 1 - pixel, column] &= (lacking <= away) * _INSIDE
    return wide
