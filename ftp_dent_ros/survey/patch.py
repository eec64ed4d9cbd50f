"""One cloud on a regular grid over its tangent plane: height and paint, in metres, no pixels.

Clouds of any camera, stride and distance become the same kind of thing, in which a neighbour's
points are looked up. The plane's z axis points at the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.paint import paint_of, slopes
from ftp_dent_ros.survey.resampling import Grid, cells, remap, way_back

# Points that the plane and the way back to the cloud's grid are fitted to, about.
_FITTED = 1000
_LEAST_POINTS = 500
# Of the grid, by the cloud's own spacing.
_COARSER = 1.5
# What the coarse paint is smoothed by: standard deviation, metres.
_SMOOTH = 0.002
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
    sigma : ndarray, shape (rows, columns), float16 or float32
        Standard uncertainty of the height, millimetres.
    light : ndarray, shape (rows, columns), float16 or float32, or None
        Logarithm of the skin image.
    """

    frame: Pose
    pitch: float
    corner: NDArray[np.float64]
    height: Grid
    sigma: NDArray[np.floating]
    light: NDArray[np.floating] | None

    @cached_property
    def surface(self) -> Grid:
        """Height, its slopes along x and y, and its uncertainty, shape (rows, columns, 4)."""
        sigma = self.sigma.astype(np.float32) * np.float32(1e-3)
        surface = np.dstack([self.height, *slopes(self.height, self.pitch), sigma])
        surface[~np.isfinite(surface).all(axis=-1)] = np.nan
        return surface

    @cached_property
    def paint(self) -> Grid:
        """Paint, its slopes along x and y (1/m), and 1 where it is known, else 0.

        The logarithm of the skin image without the light's slow changes; shape (rows, columns, 4).
        """
        return self._paint(0.0)

    @cached_property
    def coarse(self) -> Grid:
        """The same, smoothed."""
        return self._paint(_SMOOTH / self.pitch)

    def _paint(self, smooth: float) -> Grid:
        if self.light is None:
            return np.zeros((*self.height.shape, 4), np.float32)
        return paint_of(self.light.astype(np.float32), self.pitch, smooth)

    def lightened(self) -> Patch:
        """The same in a tenth of the memory, to be worked out again when it is needed."""
        light = None if self.light is None else self.light.astype(np.float16)
        return replace(self, sigma=self.sigma.astype(np.float16), light=light)

    @property
    def has_paint(self) -> bool:
        """Whether there is a skin image."""
        return self.light is not None

    @property
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
    row, column = np.nonzero(cloud.valid)
    if len(row) < _LEAST_POINTS:
        raise CloudError(
            f'the cloud has only {len(row)} points, too few to lay it on another: '
            'come closer, or light more'
        )
    some = slice(None, None, max(1, len(row) // _FITTED))
    frame = _tangent(cloud.points[row[some], column[some]].astype(float))
    turn = frame.rotation.as_matrix().astype(np.float32)
    local = (cloud.points - frame.translation.astype(np.float32)) @ turn
    place = local[row[some], column[some], :2].astype(float)
    size = pitch or _COARSER * _spacing(local)
    low, high = place.min(axis=0), place.max(axis=0)
    count = np.ceil((high - low) / size).astype(int) + 1
    back = way_back(place, np.stack([column[some], row[some]], axis=-1).astype(float))
    u, v = cells(local, low, size, count, back)
    sigma = np.where(np.isfinite(cloud.sigma), cloud.sigma, np.float32(_UNKNOWN_SIGMA))
    fields = np.dstack([local[..., 2], sigma.astype(np.float32)])
    height, deviation = np.moveaxis(remap(fields, u, v), -1, 0)
    light = None
    if skin is not None and skin.any():
        seen = np.where(skin > 0, np.log(np.maximum(skin, 1).astype(np.float32)), np.nan)
        light = remap(seen, u, v)
    return Patch(frame, size, low, height, deviation * np.float32(1e3), light)


def _tangent(points: NDArray[np.float64]) -> Pose:
    """Plane through points, x along the camera's, z towards its origin."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    normal = axes[2] * (-1 if axes[2] @ middle > 0 else 1)
    x = np.array([1.0, 0, 0]) - normal * normal[0]
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(normal, x), normal], axis=-1)
    return Pose(Rotation.from_matrix(turn), middle)


def _spacing(local: Grid) -> float:
    """Median distance between neighbouring points of a cloud."""
    steps = np.linalg.norm(np.diff(local[::4], axis=1), axis=-1)
    return float(np.nanmedian(steps))


def _sampled(layer: Grid, u: Grid, v: Grid) -> Grid:
    """Linear interpolation at positions of shape (n,), NaN beyond the layer; exact, not to 1/32.

    OpenCV 4 rounds positions to 1/32 of a cell.
    """
    rows, columns = layer.shape[:2]
    inside = (u >= 0) & (v >= 0) & (u < columns - 1) & (v < rows - 1)
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    column, row = u.astype(np.intp), v.astype(np.intp)
    a, b = (u - column)[:, None], (v - row)[:, None]
    flat = layer.reshape(rows * columns, -1)
    at = row * columns + column
    top = flat[at] * (1 - a) + flat[at + 1] * a
    bottom = flat[at + columns] * (1 - a) + flat[at + columns + 1] * a
    values = top * (1 - b) + bottom * b
    values[~inside] = np.nan
    return values
