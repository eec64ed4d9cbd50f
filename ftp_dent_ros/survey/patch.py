"""One cloud on a regular grid over its tangent plane: height and paint, in metres, no pixels.

Clouds of any camera, stride and distance become the same kind of thing, in which a neighbour's
points are looked up. The plane's z axis points at the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose

# Points that the plane and the way back to the cloud's grid are fitted to, about.
_FITTED = 1000
_LEAST_POINTS = 500
# Of the grid, by the cloud's own spacing.
_COARSER = 1.5
# Of the way back, a polynomial, and of the corrections that make it exact.
_DEGREE, _CORRECTIONS = 3, 2
# Light changes slowly along the skin, paint does not: standard deviation of what is taken off,
# and of what the coarse paint is smoothed by, metres.
_LIGHT, _SMOOTH = 0.006, 0.002
# Logarithm of a paint that is this far from its surroundings tells no more by being farther.
_MOST = 0.7
# Of the window, that must be known.
_LEAST_SHARE = 0.2
# Of a point, where a cloud does not tell its uncertainty, metres.
_UNKNOWN_SIGMA = 5e-5

Grid = NDArray[np.float32]


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
        surface = np.dstack([self.height, *_slopes(self.height, self.pitch), sigma])
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
        return _paint(self.light.astype(np.float32), self.pitch, smooth)

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
    back = _way_back(place, np.stack([column[some], row[some]], axis=-1).astype(float))
    u, v = _cells(local, low, size, count, back)
    sigma = np.where(np.isfinite(cloud.sigma), cloud.sigma, np.float32(_UNKNOWN_SIGMA))
    fields = np.dstack([local[..., 2], sigma.astype(np.float32)])
    height, deviation = np.moveaxis(_remap(fields, u, v), -1, 0)
    light = None
    if skin is not None and skin.any():
        seen = np.where(skin > 0, np.log(np.maximum(skin, 1).astype(np.float32)), np.nan)
        light = _remap(seen, u, v)
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


def _powers(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Powers up to the degree, shape (n, degree + 1)."""
    return values[:, None] ** np.arange(_DEGREE + 1)


def _way_back(place: NDArray[np.float64], pixel: NDArray[np.float64]) -> Any:
    """From x and y to the cloud's column and row, nearly: a function of a grid's x and y."""
    scale = np.abs(place).max()
    powers = [_powers(place[:, axis] / scale) for axis in (0, 1)]
    terms = np.einsum('ni,nj->nij', *powers).reshape(len(place), -1)
    weights, *_ = np.linalg.lstsq(terms, pixel, rcond=None)
    weights = weights.reshape(_DEGREE + 1, _DEGREE + 1, 2)

    def back(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        along_x, along_y = _powers(x / scale), _powers(y / scale)
        return np.stack([along_y @ weights[..., axis].T @ along_x.T for axis in (0, 1)], axis=-1)

    return back


def _cells(local: Grid, low: NDArray, size: float, count: NDArray, back: Any) -> tuple[Grid, Grid]:
    """Columns and rows of the cloud's grid at which the cells' x and y are."""
    x, y = (low[axis] + size * np.arange(count[axis]) for axis in (0, 1))
    pixel = back(x, y)
    # How the cloud's column and row change with x and y: that of the polynomial is near enough.
    along_y, along_x = np.gradient(pixel, size, axis=(0, 1))
    u, v = pixel[..., 0].astype(np.float32), pixel[..., 1].astype(np.float32)
    wanted_x, wanted_y = (each.astype(np.float32) for each in np.meshgrid(x, y))
    places = np.ascontiguousarray(local[..., :2])
    slopes = [each.astype(np.float32) for each in (along_x, along_y)]
    for _ in range(_CORRECTIONS):
        here = _remap(places, u, v)
        off_x, off_y = wanted_x - here[..., 0], wanted_y - here[..., 1]
        u = u + slopes[0][..., 0] * off_x + slopes[1][..., 0] * off_y
        v = v + slopes[0][..., 1] * off_x + slopes[1][..., 1] * off_y
    return u, v


def _remap(field: Grid, u: Grid, v: Grid) -> Grid:
    result: Any = cv2.remap(
        field.astype(np.float32, copy=False),
        np.nan_to_num(u, nan=-9.0),
        np.nan_to_num(v, nan=-9.0),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(np.nan,) * 4,
    )
    return result


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


def _slopes(field: Grid, pitch: float) -> Any:
    """Changes along x and y, central differences."""
    along_y, along_x = np.gradient(field, np.float32(pitch))
    return along_x, along_y


def _paint(logarithm: Grid, pitch: float, smooth: float) -> Grid:
    """Paint, its slopes and where it is known, of a logarithm of the skin image."""
    known = np.isfinite(logarithm)
    share = known.astype(np.float32)
    values = np.where(known, logarithm, np.float32(0))
    light = _LIGHT / pitch
    around = _mean(values, light) / np.maximum(_mean(share, light), np.float32(1e-3))
    rest = np.clip((values - around) * share, -_MOST, _MOST)
    inner = share
    if smooth:
        inner = _blurred(share, smooth)
        rest = _blurred(rest, smooth) / np.maximum(inner, np.float32(1e-3))
    along_x, along_y = _slopes(rest, pitch)
    # Beside what is not known, slopes are those of the mask.
    reach = 3 + 2 * int(np.ceil(smooth))
    whole = cv2.erode(share, np.ones((reach, reach), np.uint8), borderValue=0)
    mask = (whole > 0) & (inner > _LEAST_SHARE)
    layer = np.dstack([rest, along_x, along_y, mask.astype(np.float32)])
    layer[~mask] = 0
    return layer


def _blurred(field: Grid, sigma: float) -> Grid:
    result: Any = cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return result


def _mean(field: Any, sigma: float) -> Grid:
    """Mean over a wide window, nearly Gaussian: two boxes, which cost the same at any width."""
    side = 2 * round(sigma * np.sqrt(6) / 2) + 1
    for _ in range(2):
        field = cv2.blur(field, (side, side), borderType=cv2.BORDER_CONSTANT)
    return field
