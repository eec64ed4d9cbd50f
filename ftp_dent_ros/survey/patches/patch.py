"""One cloud on a regular grid over its tangent plane: height and paint, in metres, no pixels.

Clouds of any camera, stride and distance become the same kind of thing, in which a neighbour's
points are looked up. The plane's z axis points at the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patches.paint import paint_of, slopes
from ftp_dent_ros.survey.patches.resampling import Grid, cells, polynomial, remap

# Points that the plane and the way back to the cloud's grid are fitted to, at least.
_FITTED = 1000
_LEAST_POINTS = 500
# Of the grid, by the cloud's own spacing.
_COARSER = 1.5
# What the coarse paint is smoothed by: standard deviation, metres.
_SMOOTH = 0.002
# Of grey levels; 0 is no skin.
_LOGARITHMS = np.log(np.array([np.nan, *range(1, 256)], np.float32))
# Of a point, where a cloud does not tell its uncertainty, metres.
_UNKNOWN_SIGMA = 5e-5


@dataclass(frozen=True, eq=False)
class Patch:
    """A cloud over its tangent plane; arrays of shape (rows, columns), NaN where unknown.

    Attributes
    ----------
    frame : Pose
        Of the patch in the cloud's frame: x and y along the skin, z towards the camera.
    pitch : float
        Of the grid, metres.
    corner : ndarray, shape (2,)
        x and y of the first row and column, metres; x goes with columns.
    height : ndarray, shape (rows, columns), float32
        Metres.
    sigma : ndarray, shape (rows, columns), float32
        Standard uncertainty of the height, millimetres.
    light : ndarray, shape (rows, columns), float32, or None
        Logarithm of the skin image.
    """

    frame: Pose
    pitch: float
    corner: NDArray[np.float64]
    height: Grid
    sigma: Grid
    light: Grid | None

    @cached_property
    def surface(self) -> Grid:
        """Height, its slopes along x and y, and its uncertainty, shape (rows, columns, 4)."""
        sigma = self.sigma * np.float32(1e-3)
        along_x, along_y = slopes(self.height, self.pitch)
        surface: Any = cv2.merge([self.height, along_x, along_y, sigma])
        unknown = np.isnan(along_x + along_y + sigma)
        unknown[[0, -1]] = unknown[:, [0, -1]] = True
        surface[unknown] = np.nan
        return surface

    @property
    def paint(self) -> Grid:
        """Paint, its slopes along x and y (1/m), and 1 where it is known, else 0.

        The logarithm of the skin image without the light's slow changes; shape (rows, columns, 4).
        """
        return self._paints[0]

    @property
    def coarse(self) -> Grid:
        """The same, smoothed."""
        return self._paints[1]

    @cached_property
    def _paints(self) -> tuple[Grid, Grid]:
        if self.light is None:
            nothing = np.zeros((*self.height.shape, 4), np.float32)
            return nothing, nothing
        return paint_of(self.light, self.pitch, _SMOOTH / self.pitch)

    @property
    def has_paint(self) -> bool:
        """Whether there is a skin image."""
        return self.light is not None

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the cells with a height."""
        return np.isfinite(self.surface[..., 0])

    def points(self, row: NDArray[np.integer], column: NDArray[np.integer]) -> NDArray:
        """Points of cells, shape (n, 3), metres, in the patch's frame."""
        x = self.corner[0] + self.pitch * column
        y = self.corner[1] + self.pitch * row
        return np.stack([x, y, self.surface[row, column, 0]], axis=-1).astype(float)

    def looked_up(self, layer: Grid, points: NDArray[np.float64]) -> Grid:
        """Values of a layer below points of shape (n, 3), linearly; NaN beyond the grid."""
        place = ((points[:, :2] - self.corner) / self.pitch).astype(np.float32)
        return _sampled(layer, place[:, 0], place[:, 1])


def patch_of(
    cloud: Cloud, skin: NDArray[np.uint8] | None = None, pitch: float | None = None
) -> Patch:
    """Patch of a cloud in its camera's frame.

    Parameters
    ----------
    cloud : Cloud
    skin : ndarray, shape (rows, columns), uint8, optional
        Image of the skin on the cloud's grid; 0 where there is none.
    pitch : float, optional
        Metres; somewhat more than the cloud's own spacing by default.

    Raises
    ------
    CloudError
        It has too few points.
    """
    valid = cloud.valid
    points = np.count_nonzero(valid)
    if points < _LEAST_POINTS:
        raise CloudError(
            f'the cloud has only {points} points, too few to lay it on another: '
            'come closer, or light more'
        )
    step = max(1, math.isqrt(points // _FITTED))
    row, column = step * np.array(np.nonzero(valid[::step, ::step]))
    frame = _tangent(cloud.points[row, column].astype(float))
    back = frame.inverse()
    matrix = np.column_stack([back.rotation.as_matrix(), back.translation])
    everywhere = cloud.points.astype(np.float32, copy=False)
    places: Any = cv2.transform(everywhere, matrix[:2])
    heights: Any = cv2.transform(everywhere, matrix[2:])
    place = places[row, column].astype(float)
    size = pitch or _COARSER * _spacing(everywhere)
    low, high = place.min(axis=0), place.max(axis=0)
    count = np.ceil((high - low) / size).astype(int) + 1
    pixel = polynomial(place, np.stack([column, row], axis=-1).astype(float))
    u, v = cells(places, low, size, count, pixel)
    sigma = np.where(np.isfinite(cloud.sigma), cloud.sigma, np.float32(_UNKNOWN_SIGMA))
    height = remap(heights, u, v)
    deviation = remap(sigma.astype(np.float32, copy=False) * np.float32(1e3), u, v)
    light = None
    if skin is not None and skin.any():
        light = remap(_LOGARITHMS[skin], u, v)
    return Patch(frame, size, low, height, deviation, light)


def outline_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The outermost points each way, and some between."""
    angles = np.linspace(0, np.pi, 8, endpoint=False)
    along = points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    outer = np.concatenate([along.argmin(axis=0), along.argmax(axis=0)])
    inner = np.linspace(0, len(points) - 1, 40).astype(int)
    return points[np.unique(np.concatenate([outer, inner]))]


def _tangent(points: NDArray[np.float64]) -> Pose:
    """Plane through points, x along the camera's, z towards its origin."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    normal = axes[2] * (-1 if axes[2] @ middle > 0 else 1)
    x = np.array([1.0, 0, 0]) - normal * normal[0]
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(normal, x), normal], axis=-1)
    return Pose(Rotation.from_matrix(turn), middle)


def _spacing(points: Grid) -> float:
    """Median distance between neighbouring points of a cloud."""
    steps = np.linalg.norm(np.diff(points[:: max(1, len(points) // 24)], axis=1), axis=-1)
    return float(np.nanmedian(steps))


def _sampled(layer: Grid, u: Grid, v: Grid) -> Grid:
    """Linear interpolation at positions of shape (n,), NaN beyond the layer; exact, not to 1/32.

    OpenCV 4 rounds positions to 1/32 of a cell.
    """
    rows, columns = layer.shape[:2]
    inside = (u >= 0) & (v >= 0) & (u < columns - 1) & (v < rows - 1)
    u, v = np.where(inside, u, np.float32(0)), np.where(inside, v, np.float32(0))
    column, row = np.floor(u), np.floor(v)
    a, b = (u - column)[:, None], (v - row)[:, None]
    flat = layer.reshape(rows * columns, -1)
    at = row.astype(np.intp) * columns + column.astype(np.intp)
    # Whole rows taken, and sums in place: a quarter of the time of the same by indices.
    low, low_next, high, high_next = (
        flat.take(at + beside, axis=0) for beside in (0, 1, columns, columns + 1)
    )
    low += a * (low_next - low)
    high += a * (high_next - high)
    low += b * (high - low)
    low[~inside] = np.nan
    return low
