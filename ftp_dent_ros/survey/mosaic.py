"""One picture of the whole unrolled skin: image, deviation and coverage as layers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.dent import Inspection
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.gaps import Gap, find_gaps
from ftp_dent_ros.survey.result import CoverageCells
from ftp_dent_ros.survey.unrolling import Unrolled

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
        self._count, self._image, self._seen, self._deviation, self._weight = (
            np.zeros(size, np.float32) for _ in range(5)
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
        known = cloud.valid
        points = pose.apply(cloud.points[known].astype(float))
        place = self.skin.place(points)
        column, row = np.floor((place[:, :2] - self.low) / PIXEL).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < self.shape[1]) & (row < self.shape[0])
        at = (row * self.shape[1] + column)[inside]
        pixels, index = np.unique(at, return_inverse=True)

        def summed(values: NDArray) -> NDArray:
            return np.bincount(index, values, len(pixels))

        count = summed(np.ones(len(at)))
        self._count[pixels] += count
        self._views[pixels] += 1
        for axis in range(3):
            self._place[pixels, axis] += summed(points[inside, axis] - self._origin[axis])
        if skin is not None:
            light = skin[known][inside].astype(float)
            self._image[pixels] += summed(light)
            self._seen[pixels] += summed(light > 0)
        if found is None:
            return
        deviation = found.deviation[known][inside]
        told = np.isfinite(deviation)
        self._deviation[pixels] += summed(np.where(told, deviation, 0))
        self._weight[pixels] += summed(told)
        # Of one pixel's points the last counts; they are alike.
        noise, findable = (np.full(len(pixels), np.nan, np.float32) for _ in range(2))
        noise[index] = found.noise[known][inside]
        findable[index] = found.findable[known][inside]
        better = np.isfinite(findable) & ~(self._findable[pixels] <= findable)
        chosen = pixels[better]
        self._findable[chosen], self._noise[chosen] = findable[better], noise[better]
        self._best[chosen] = number
        unknown = self._best[pixels] < 0
        self._best[pixels[unknown]] = number

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
        count = self._by_cell(self._count, np.sum)
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
        return self._by_cell((self._count > 0).astype(np.float32), np.mean) >= _MEASURED

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
