"""One cloud on a regular grid over its tangent plane: height and paint, in metres, no pixels.

Clouds of any camera, stride and distance become the same kind of thing, in which a neighbour's
points are looked up. The plane's z axis points at the camera.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.raster import Grid, cells, polynomial, remap, some_of

# Points that tell a plane and the way back to the cloud's grid.
_LEAST_POINTS = 500
# Of grey levels; 0 is no skin.
_LOGARITHMS = np.log(np.array([np.nan, *range(1, 256)], np.float32))

# Logarithm of a paint that is this far from its surroundings tells no more by being farther.
_MOST = 0.7

# Of the logarithm of light: a tenth of a skin image's noise.
_LIGHT_STEP = 5e-4
# Steps either way, and what stands for nothing.
_MOST_STEPS, _NONE = 32000, -32768
# Cells a side that share one uncertainty.
_SHARED = 4


@dataclass(frozen=True, eq=False)
class SkinPatch:
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
        # What the coarse paint is smoothed by: standard deviation, metres.
        return paint_of(self.light, self.pitch, 0.002 / self.pitch)

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
) -> SkinPatch:
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
    some = some_of(valid)
    frame = _tangent(cloud.points[some].astype(float))
    back = frame.inverse()
    matrix = np.column_stack([back.rotation.as_matrix(), back.translation])
    everywhere = cloud.points.astype(np.float32, copy=False)
    places: Any = cv2.transform(everywhere, matrix[:2])
    heights: Any = cv2.transform(everywhere, matrix[2:])
    place = places[some].astype(float)
    # Of the grid, by the cloud's own spacing.
    size = pitch or 1.5 * _spacing(everywhere)
    low, high = place.min(axis=0), place.max(axis=0)
    count = np.ceil((high - low) / size).astype(int) + 1
    u, v = cells(places, some, low, size, count)
    # Of a point, where a cloud does not tell its uncertainty, metres.
    sigma = np.where(np.isfinite(cloud.sigma), cloud.sigma, np.float32(5e-5))
    height = remap(heights, u, v)
    deviation = remap(sigma.astype(np.float32, copy=False) * np.float32(1e3), u, v)
    light = None
    if skin is not None and skin.any():
        light = remap(_LOGARITHMS[skin], u, v)
    return SkinPatch(frame, size, low, height, deviation, light)


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


def slopes(field: Grid, pitch: float) -> tuple[Any, Any]:
    """Changes along x and y, central differences; 0 on the outermost cells."""
    scale = 1 / (2 * pitch)
    along_x = cv2.Sobel(field, cv2.CV_32F, 1, 0, ksize=1, scale=scale)
    along_y = cv2.Sobel(field, cv2.CV_32F, 0, 1, ksize=1, scale=scale)
    return along_x, along_y


def paint_of(logarithm: Grid, pitch: float, smooth: float) -> tuple[Grid, Grid]:
    """Paint, its slopes and where it is known, of a logarithm of the skin image.

    Parameters
    ----------
    logarithm : ndarray, shape (rows, columns), float32
        NaN where unknown.
    pitch : float
        Of the grid, metres.
    smooth : float
        Standard deviation that the second paint is smoothed by, cells.

    Returns
    -------
    paint, coarse : ndarray, shape (rows, columns, 4), float32
        Paint, its slopes along x and y (1/m), and 1 where it is known, else 0; the second
        smoothed.
    """
    known = np.isfinite(logarithm)
    share = known.astype(np.float32)
    # What is left of the light is level, so that windows may be one-sided at the rim.
    values = np.where(known, logarithm - _light(logarithm, known), np.float32(0))
    # Light changes slowly along the skin, paint does not: standard deviation of what is taken off,
    # metres.
    light = 0.006 / pitch
    window = _mean(share, light)
    around = _mean(values, light) / np.maximum(window, np.float32(1e-3))
    rest = np.clip((values - around) * share, -_MOST, _MOST)
    # Of the window, that must be known: at a rim, to one side of which the skin and its image's
    # own windows end, light would be taken for paint.
    inside = (share * (window > 0.93)).astype(np.uint8)
    layers = []
    for width in (0.0, smooth):
        if width:
            rest = _blurred(rest, width) / np.maximum(_blurred(share, width), np.float32(1e-3))
        # Beside what is not known, slopes are those of the mask.
        reach = 3 + 2 * math.ceil(width)
        around_it = np.ones((reach, reach), np.uint8)
        mask = cv2.erode(inside, around_it, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        layer = cv2.merge([rest, *slopes(rest, pitch), mask.astype(np.float32)])
        layers.append(layer * layer[..., 3:])
    return layers[0], layers[1]


def _light(logarithm: Grid, known: NDArray[np.bool_]) -> Grid:
    """Polynomial through a logarithm of light, by some of its cells."""
    row, column = some_of(known, 1500)
    if not len(row):
        return np.zeros_like(logarithm)
    place, values = np.stack([column, row], axis=-1).astype(float), logarithm[row, column]
    through = polynomial(place, values[:, None].astype(float))
    rows, columns = (np.arange(float(size)) for size in logarithm.shape)
    return through(columns, rows)[0].astype(np.float32)


def _blurred(field: Grid, sigma: float) -> Grid:
    result: Any = cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return result


def _mean(field: Any, sigma: float) -> Grid:
    """Mean over a wide window, nearly Gaussian: two boxes, which cost the same at any width."""
    side = 2 * round(sigma * np.sqrt(6) / 2) + 1
    for _ in range(2):
        field = cv2.blur(field, (side, side), borderType=cv2.BORDER_CONSTANT)
    return field


@dataclass(frozen=True, eq=False)
class _FoldedGrid:
    """A grid whose numbers differ little from column to column: middle + step * whole number."""

    shape: tuple[int, ...]
    middle: float
    step: float
    packed: bytes

    @classmethod
    def of(cls, grid: Grid, middle: float, step: float) -> _FoldedGrid:
        steps = np.clip((grid - middle) / step, -_MOST_STEPS, _MOST_STEPS)
        whole = np.rint(np.where(np.isfinite(grid), steps, _NONE)).astype(np.int16)
        changes = np.diff(whole, axis=1, prepend=np.int16(0))
        # Of zlib: the quickest.
        return cls(grid.shape, middle, step, zlib.compress(changes.tobytes(), 1))

    def unfolded(self) -> Grid:
        changes = np.frombuffer(zlib.decompress(self.packed), np.int16).reshape(self.shape)
        # Sums that do not fit come round to where they were.
        whole = np.cumsum(changes, axis=1, dtype=np.int16)
        steps = np.where(whole == _NONE, np.nan, whole.astype(float))
        return (self.middle + self.step * steps).astype(np.float32)


@dataclass(frozen=True, eq=False)
class FoldedPatch:
    """A patch in small numbers; its uncertainty is that of every fourth cell each way."""

    frame: Pose
    pitch: float
    corner: NDArray[np.float64]
    height: _FoldedGrid
    sigma: NDArray[np.float16]
    light: _FoldedGrid | None

    @classmethod
    def of(cls, patch: SkinPatch) -> FoldedPatch:
        """Fold a patch."""
        low, high = float(np.nanmin(patch.height)), float(np.nanmax(patch.height))
        # Least step of heights, metres: a quarter of what no pair is better than.
        step = max(2.5e-7, (high - low) / 2 / _MOST_STEPS)
        sigma = patch.sigma[::_SHARED, ::_SHARED]
        # Beside the rim, where heights end and not their uncertainty.
        sigma = np.where(np.isfinite(sigma), sigma, np.nanmax(sigma))
        light = None
        if patch.light is not None:
            light = _FoldedGrid.of(patch.light, float(np.nanmean(patch.light)), _LIGHT_STEP)
        height = _FoldedGrid.of(patch.height, (low + high) / 2, step)
        coarse = sigma.astype(np.float16)
        return cls(patch.frame, patch.pitch, patch.corner, height, coarse, light)

    @lru_cache(maxsize=8)  # noqa: B019 - the last that were used, with their layers, on purpose
    def unfolded(self) -> SkinPatch:
        """The patch; the last ones are kept."""
        rows, columns = self.height.shape
        sigma = np.repeat(np.repeat(self.sigma, _SHARED, axis=0), _SHARED, axis=1)
        return SkinPatch(
            self.frame,
            self.pitch,
            self.corner,
            self.height.unfolded(),
            sigma[:rows, :columns].astype(np.float32),
            None if self.light is None else self.light.unfolded(),
        )
