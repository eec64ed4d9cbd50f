"""One picture of the whole unrolled skin: image, deviation and coverage as layers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Inspection
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.resampling import cells, polynomial
from ftp_dent_ros.survey.result import CoverageCells
from ftp_dent_ros.survey.unrolled import Gap, Unrolled, find_gaps

# Side of a pixel, and pixels a side of a coverage cell.
PIXEL, PIXELS_A_CELL = 0.002, 5
# Of a cell's pixels, that were measured if the cell was.
_MEASURED = 0.5
_LARGEST = 1 << 28  # pixels


class Mosaic:
    """Sums over clouds on the unrolled skin.

    Parameters
    ----------
    skin : Unrolled
    low, high : ndarray, shape (2,)
        Least and largest x and y, metres.

    Raises
    ------
    CloudError
        The skin would be too large for a picture.
    """

    def __init__(self, skin: Unrolled, low: NDArray, high: NDArray) -> None:
        side = PIXEL * PIXELS_A_CELL
        self.skin, self.low = skin, np.floor(low / side) * side
        columns, rows = (np.ceil((high - self.low) / side).astype(int) + 1) * PIXELS_A_CELL
        if columns * rows > _LARGEST:
            raise CloudError(
                f'the clouds are spread over {columns * PIXEL:.0f} m by {rows * PIXEL:.0f} m: '
                'check their poses'
            )
        self.shape = rows, columns
        size = rows * columns
        self._image, self._seen, self._deviation, self._weight = (
            np.zeros(size, np.float32) for _ in range(4)
        )
        self._place = np.zeros((size, 3), np.float32)
        self._origin = skin.origin
        self._views = np.zeros(size, np.uint16)
        self._noise, self._findable = (np.full(size, np.nan, np.float32) for _ in range(2))
        self._best = np.full(size, -1, np.int32)

    def add(
        self,
        number: int,
        cloud: Cloud,
        pose: Pose,
        skin: NDArray[np.uint8] | None,
        found: Inspection | None,
    ) -> None:
        """Another cloud, in its camera's frame, with the image of its skin and its inspection."""
        valid = cloud.valid
        points = pose.apply(np.where(valid[..., None], cloud.points, np.nan).astype(float))
        pixels, index = self._seen_by(self.skin.place(points)[..., :2], valid)
        if not len(pixels):
            return
        self._views[pixels] += 1
        self._place[pixels] += points.reshape(-1, 3)[index] - self._origin
        if skin is not None:
            light = skin.ravel()[index]
            self._image[pixels] += light
            self._seen[pixels] += light > 0
        if found is None:
            return
        deviation = found.deviation.ravel()[index]
        known = np.isfinite(deviation)
        self._deviation[pixels] += np.where(known, deviation, 0)
        self._weight[pixels] += known
        findable, noise = found.findable.ravel()[index], found.noise.ravel()[index]
        better = np.isfinite(findable) & ~(self._findable[pixels] <= findable)
        chosen = pixels[better]
        self._findable[chosen], self._noise[chosen] = findable[better], noise[better]
        self._best[chosen] = number
        unknown = self._best[pixels] < 0
        self._best[pixels[unknown]] = number

    def _seen_by(
        self, places: NDArray[np.float64], valid: NDArray[np.bool_]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pixels whose middle a cloud has a point at, and the number of the nearest point.

        So what is measured ends where the points do, and not a pixel later, and clouds with fewer
        points than the picture has pixels leave no holes.
        """
        # Points that the way back to a cloud's grid is fitted to: about, and at least.
        step = max(1, math.isqrt(np.count_nonzero(valid) // 1500))
        row, column = step * np.array(np.nonzero(valid[::step, ::step]))
        some = places[row, column]
        nothing = np.zeros(0, np.intp)
        if len(some) < 20:
            return nothing, nothing
        rows, columns = self.shape
        begin = np.maximum(np.floor((some.min(axis=0) - self.low) / PIXEL).astype(int) - 8, 0)
        end = np.ceil((some.max(axis=0) - self.low) / PIXEL).astype(int) + 8
        size = np.minimum(end, [columns, rows]) - begin
        if (size <= 0).any():
            return nothing, nothing
        corner = self.low + PIXEL * (begin + 0.5)
        # From the corner on, single precision is enough.
        back = polynomial(some - corner, np.stack([column, row], axis=-1).astype(float))
        u, v = cells((places - corner).astype(np.float32), np.zeros(2), PIXEL, size, back)
        u, v = np.rint(u).astype(int), np.rint(v).astype(int)
        height, width = valid.shape
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        inside[inside] = valid[v[inside], u[inside]]
        down, across = np.nonzero(inside)
        return (begin[1] + down) * columns + begin[0] + across, v[inside] * width + u[inside]

    @property
    def image(self) -> NDArray[np.uint8]:
        """Skin, 0 where it was not seen."""
        mean = self._image / np.maximum(self._seen, 1)
        return (
            np.where(self._seen > 0, np.clip(mean, 1, 255), 0).astype(np.uint8).reshape(self.shape)
        )

    @property
    def deviation(self) -> NDArray[np.float32]:
        """Depth below the undeformed contour, metres; NaN where it is not known."""
        mean = self._deviation / np.maximum(self._weight, 1)
        return np.where(self._weight > 0, mean, np.float32(np.nan)).reshape(self.shape)

    @property
    def views(self) -> NDArray[np.uint16]:
        """How many clouds have points in each pixel."""
        return self._views.reshape(self.shape)

    def cloud(self) -> Cloud:
        """Mean point of each cell, with the skin image as intensity and the noise as sigma."""
        count = self._by_cell(self._views.astype(np.float32), np.sum)
        mean = (
            np.stack([self._by_cell(each, np.sum) for each in self._place.T], axis=-1)
            / np.maximum(count, 1)[..., None]
        )
        points = np.where(count[..., None] > 0, mean + self._origin, np.nan).astype(np.float32)
        seen = self._by_cell(self._seen, np.sum)
        light = self._by_cell(self._image, np.sum) / np.maximum(seen, 1)
        noise = self._by_cell(self._noise, _middle)
        return Cloud(points, light.astype(np.float32), noise.astype(np.float32))

    def coverage(self) -> CoverageCells:
        """What was measured, cell by cell."""
        measured = self.measured()
        points = self.cloud().points[measured]
        return CoverageCells(
            PIXEL * PIXELS_A_CELL,
            points,
            self._by_cell(self._findable, _middle)[measured].astype(np.float32),
            self._by_cell(self._noise, _middle)[measured].astype(np.float32),
            self._by_cell(self._views, np.max)[measured].astype(np.int64),
            self._by_cell(self._best, np.max)[measured].astype(np.int64),
        )

    def measured(self) -> NDArray[np.bool_]:
        """Mask of the cells of which most was measured."""
        return self._by_cell((self._views > 0).astype(np.float32), np.mean) >= _MEASURED

    def gaps(self) -> list[Gap]:
        """What was not measured between what was, the largest first."""
        return find_gaps(self.measured(), self.low, PIXEL * PIXELS_A_CELL)

    def _by_cell(self, values: NDArray, how) -> NDArray:
        rows, columns = (size // PIXELS_A_CELL for size in self.shape)
        cells = values.reshape(rows, PIXELS_A_CELL, columns, PIXELS_A_CELL)
        return how(cells.transpose(0, 2, 1, 3).reshape(rows, columns, -1), axis=-1)


def _middle(values: NDArray, axis: int) -> NDArray:
    known = np.isfinite(values)
    ordered = np.sort(np.where(known, values, np.inf), axis=axis)
    middle = np.maximum(known.sum(axis=axis) - 1, 0) // 2
    found = np.take_along_axis(ordered, middle[..., None], axis=axis)[..., 0]
    return np.where(np.isfinite(found), found, np.nan)
