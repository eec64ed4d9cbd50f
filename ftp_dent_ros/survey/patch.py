"""One cloud on a regular grid over its tangent plane: height and paint, in metres, no pixels.

Clouds of any camera, stride and distance become the same kind of thing, in which a neighbour's
points are looked up. The plane's z axis points at the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache, partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.raster import Grid, cells, remap, some_of
from ftp_dent_ros.survey.unrolled import LARGEST

# Of grey levels; 0 is no skin.
_LOGARITHMS = np.log(np.array([np.nan, *range(1, 256)], np.float32))


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of a patch that are looked up in another.

    Attributes
    ----------
    heights, paint : ndarray, shape (n, 3)
        Metres, in the patch's frame.
    height_values, paint_values : ndarray, shape (n, 4)
        As `SkinPatch.surface` and `SkinPatch.paint` have them.
    """

    heights: NDArray[np.float64]
    height_values: Grid
    paint: NDArray[np.float64]
    paint_values: Grid

    @cached_property
    def few(self) -> Samples:
        """Every fourth of them: enough to find the way; the last steps are by all."""
        return Samples(*(getattr(self, each.name)[::4] for each in fields(self)))


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
    light: Grid | None = None

    @cached_property
    def surface(self) -> Grid:
        """Height, its slopes along x and y, and its uncertainty, shape (rows, columns, 4).

        The height is less by half of what it changes by from the patch's middle on, by its slopes.
        """
        slopes: Any = np.gradient(self.height, self.pitch)
        y, x = self.corner[::-1, None, None] + self.pitch * np.indices(self.height.shape)
        rise = ((slopes[1] * x + slopes[0] * y) / 2).astype(np.float32)
        sigma = self.sigma * np.float32(1e-3)
        surface: Any = cv2.merge([self.height - rise, *slopes[::-1], sigma])
        unknown = np.isnan(surface).any(axis=-1)
        unknown[[0, -1]] = unknown[:, [0, -1]] = True
        surface[unknown] = np.nan
        return surface

    @cached_property
    def paints(self) -> tuple[Grid, Grid]:
        """Paint, its slopes along x and y (1/m), and 1 where it is known, else 0; and smoothed.

        The logarithm of the skin image without the light's slow changes, shape (rows, columns, 4);
        and by a standard deviation of 2 mm, with 1 where that is known, (rows, columns, 2).
        """
        values = np.full_like(self.height, np.nan) if self.light is None else self.light
        known = np.isfinite(values)
        share = known.astype(np.float32)
        values = np.where(known, values, np.float32(0))
        # Light changes slowly along the skin, paint does not: standard deviation of what is taken
        # off, metres.
        window = _blurred(share, 0.006 / self.pitch)
        around = _blurred(values, 0.006 / self.pitch) / np.maximum(window, np.float32(1e-3))
        # Paint that is so far from its surroundings tells no more by being farther.
        rest = np.clip((values - around) * share, -0.7, 0.7)
        # Of the window, that must be known: at a rim, to one side of which the skin and its
        # image's own windows end, light would be taken for paint.
        inside = share * (window > 0.93)
        width = 0.002 / self.pitch
        smooth = _blurred(rest, width) / np.maximum(_blurred(share, width), np.float32(1e-3))
        # Beside what is not known, slopes are those of the mask.
        fine, coarse = (
            cv2.erode(
                inside,
                np.ones((reach, reach), np.uint8),
                borderType=cv2.BORDER_CONSTANT,
                borderValue=0,
            )
            for reach in (3, 3 + 2 * math.ceil(width))
        )
        slopes: Any = np.gradient(rest, self.pitch)
        paint: Any = cv2.merge([rest, *slopes[::-1], fine])
        smoothed: Any = cv2.merge([smooth * coarse, coarse])
        return paint * fine[..., None], smoothed

    @cached_property
    def samples(self) -> Samples:
        """Heights on a regular grid; of the paint, in every square, the cell that changes most."""
        # Distance of heights, metres, and side of the squares: at about this distance errors are
        # independent. And how many at most: more cost time and tell no more.
        step = max(1, round(0.006 / self.pitch))
        known = np.isfinite(self.surface[..., 0])
        row, column = step * np.array(np.nonzero(known[::step, ::step]))
        some = slice(None, None, -(-len(row) // 3000) or 1)
        row, column = row[some], column[some]
        paint = self.paints[0]
        change = np.square(paint[..., 1:3]).sum(axis=-1) * known
        side = max(1, round(0.004 / self.pitch))
        most = cv2.dilate(change, np.ones((side, side), np.uint8))
        down, across = np.nonzero((change == most) & (change > 0))
        # Those that change most tell most, and grain least.
        chosen = np.sort(np.argsort(-change[down, across], kind='stable')[:4000])
        down, across = down[chosen], across[chosen]
        return Samples(
            self.points(row, column),
            self.surface[row, column],
            self.points(down, across),
            paint[down, across],
        )

    def points(self, row: NDArray[np.integer], column: NDArray[np.integer]) -> NDArray:
        """Points of cells, shape (n, 3), metres, in the patch's frame."""
        x = self.corner[0] + self.pitch * column
        y = self.corner[1] + self.pitch * row
        return np.stack([x, y, self.height[row, column]], axis=-1).astype(float)

    def below(self, points: NDArray[np.float64]) -> Grid:
        """Height, slopes and uncertainty below points of shape (n, 3); NaN beyond the grid.

        Between cells the skin bends: as far as their chord is on the one side of it their tangents
        are on the other.
        """
        found = self.looked_up(self.surface, points)
        found[:, 0] += (found[:, 1:3] * points[:, :2]).sum(axis=1) / 2
        return found

    def looked_up(self, layer: Grid, points: NDArray[np.float64]) -> Grid:
        """Values of a layer below points of shape (n, 3), linearly; NaN beyond the grid.

        OpenCV 4 rounds positions to 1/32 of a cell.
        """
        at = ((points[:, 1::-1] - self.corner[::-1]) / self.pitch).T
        channels = np.moveaxis(layer, -1, 0)
        values = [map_coordinates(each, at, np.float32, 1, cval=np.nan) for each in channels]
        return np.stack(values, axis=-1)


def patch_of(cloud: Cloud) -> SkinPatch:
    """Patch of a cloud in its camera's frame, with the image of its skin if it has one.

    Raises
    ------
    CloudError
        It has too few points, or they are no skin that a camera saw.
    """
    valid = cloud.valid
    # Of a cubic of rows and columns.
    if min(valid.shape) < 4:
        raise CloudError(
            'the cloud has less than 4 rows or columns of points, so that it is not the grid of a '
            'camera: publish it as it was measured'
        )
    # That tell a plane and the way back to the cloud's grid.
    if np.count_nonzero(valid) < 500:
        raise CloudError(
            'the cloud has less than 500 points, too few to lay it on another: come closer, or '
            'light more'
        )
    some = some_of(valid)
    frame = _tangent(cloud.points[some].astype(float))
    everywhere = frame.inverse().apply(cloud.points.astype(np.float32, copy=False))
    places, heights = np.ascontiguousarray(everywhere[..., :2]), everywhere[..., 2]
    # Of the grid, by the cloud's own spacing.
    steps = np.linalg.norm(np.diff(everywhere[:: max(1, len(everywhere) // 24)], axis=1), axis=-1)
    size = 1.5 * float(np.nanmedian(steps))
    _check_spread(places[valid], heights[valid], size)
    low = places[some].min(axis=0).astype(float)
    count = np.ceil(np.ptp(places[some], axis=0) / size).astype(int) + 1
    u, v = cells(places, some, low, size, count)
    # Of a point, where a cloud does not tell its uncertainty, metres.
    sigma = np.where(np.isfinite(cloud.sigma), cloud.sigma, np.float32(5e-5))
    height = remap(heights, u, v)
    deviation = remap(sigma.astype(np.float32, copy=False) * np.float32(1e3), u, v)
    light = remap(_LOGARITHMS[cloud.skin], u, v) if cloud.skin.any() else None
    return SkinPatch(frame, size, low, height, deviation, light)


def _check_spread(places: Grid, heights: Grid, size: float) -> None:
    """See that points about a tangent plane, their neighbours so far apart, are of one skin."""
    sides, high = np.ptp(places, axis=0), float(np.ptp(heights))
    if np.prod(sides) > LARGEST or high > max(sides):
        raise CloudError(
            'the points of the cloud are farther apart than an aircraft is large, or deeper than '
            'wide, which is no skin: correct its unit, metres, or its points far off'
        )
    # Neighbours are so much farther apart at most: in noise they are more; and so much nearer at
    # most, where a thousandth of the picture is lit.
    mean = math.sqrt(float(np.prod(sides)) / len(places))
    if not mean / 30 < size < 6 * mean:
        raise CloudError(
            'neighbours in the cloud are not about as far apart as its points are in the mean: '
            'it is noise, or has points far off'
        )


def _tangent(points: NDArray[np.float64]) -> Pose:
    """Plane through points, x along the camera's, z towards its origin."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    normal = axes[2] * (-1 if axes[2] @ middle > 0 else 1)
    x = np.array([1.0, 0, 0]) - normal * normal[0]
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(normal, x), normal], axis=-1)
    return Pose(Rotation.from_matrix(turn), middle)


def _blurred(field: Grid, sigma: float) -> Grid:
    result: Any = cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return result


def folded(patch: SkinPatch) -> Callable[[], SkinPatch]:
    """What makes a patch again, in a tenth of its memory: its grids as one picture."""
    grids = [each for each in (patch.height, patch.sigma, patch.light) if each is not None]
    low, high = (
        np.array([[[float(extreme(each))]] for each in grids])
        for extreme in (np.nanmin, np.nanmax)
    )
    # Least steps: of heights, metres, a quarter of what no pair is better than; of their
    # uncertainty, millimetres, and of the logarithm of light a tenth of a skin image's noise.
    least = np.array([2.5e-7, 1e-6, 5e-4])[: len(grids), None, None]
    step = np.maximum(least, (high - low) / 65000)
    # 0 is unknown.
    whole = np.nan_to_num(np.rint((np.stack(grids) - low) / step) + 1).astype(np.uint16)
    picture = cv2.imencode('.png', np.concatenate(whole))[1]
    return partial(_made, patch.frame, patch.pitch, patch.corner, picture, low, step)


@lru_cache(maxsize=8)
def unfolded(make: Callable[[], SkinPatch]) -> SkinPatch:
    """A patch that was `folded`; the last ones are kept, with their layers."""
    return make()


def _made(
    frame: Pose,
    pitch: float,
    corner: NDArray[np.float64],
    picture: Any,
    low: NDArray[np.float64],
    step: NDArray[np.float64],
) -> SkinPatch:
    whole = np.stack(np.split(np.asarray(cv2.imdecode(picture, cv2.IMREAD_UNCHANGED)), len(low)))
    grids = np.where(whole > 0, low + step * (whole - 1.0), np.nan).astype(np.float32)
    return SkinPatch(frame, pitch, corner, *grids)
