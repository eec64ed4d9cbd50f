"""One picture of the whole unrolled skin: image, deviation and coverage as layers."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.dent import Inspection
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.raster import Raster, remap
from ftp_dent_ros.survey.result import CoverageCells
from ftp_dent_ros.survey.unrolled import CELL, Gap, Unrolled, find_gaps

#: Pixels a side of a cell, and the side of a pixel, metres.
PIXELS_A_CELL = 5
PIXEL = CELL / PIXELS_A_CELL
# Of a cell that no group has claimed.
_FREE = -1


class Mosaic(Raster):
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

    Attributes
    ----------
    views : ndarray, shape (rows, columns), uint16
        How many clouds have points in each pixel.
    findable : ndarray, shape (cells' rows, cells' columns), float32
        Of each cell the smallest depth of a dent that would have been found in its middle by the
        best cloud, metres; NaN where it is not known.
    """

    def __init__(self, skin: Unrolled, low: NDArray, high: NDArray) -> None:
        super().__init__(skin, low, high, PIXEL, PIXELS_A_CELL)
        self.views = np.zeros(self.shape, np.uint16)
        self._image, self._seen, self._height, self._deviation, self._squares, self._weight = (
            np.zeros((6, *self.shape), np.float32)
        )
        self._steps = np.zeros(self.shape, np.uint8)
        # Of each cell the group of clouds that is drawn there.
        cells = self.shape[0] // PIXELS_A_CELL, self.shape[1] // PIXELS_A_CELL
        self._owner = np.full(cells, _FREE)
        self.findable = np.full(cells, np.nan, np.float32)

    def claim(self, places: NDArray, group: int) -> None:
        """Have one group of clouds alone drawn in the cells of its places, (n, 2 or more)."""
        column, row = np.floor((places[:, :2] - self.low) / CELL).astype(int).T
        self._owner[row, column] = group

    def owner(self, place: NDArray[np.float64]) -> int:
        """The group that is drawn at a place of shape (3,); less than 0 where none is."""
        at = np.floor((self.skin.place(place)[1::-1] - self.low[::-1]) / CELL).astype(int)
        row, column = np.clip(at, 0, np.array(self._owner.shape) - 1)
        return int(self._owner[row, column])

    def add(self, cloud: Cloud, pose: Pose, found: Inspection | None, group: int = _FREE) -> None:
        """Another cloud, in its camera's frame, and its inspection.

        A pixel is seen where the cloud has a point nearest to its middle: so what is measured ends
        where the points do, and clouds with fewer points than pixels leave no holes. What another
        group has claimed is measured, and not drawn.
        """
        places, window, u, v = self.laid(cloud, pose, cloud.valid)
        height = remap(places[..., 2], u, v, cv2.INTER_NEAREST)
        down, across = (
            slice(each.start // PIXELS_A_CELL, each.stop // PIXELS_A_CELL) for each in window
        )
        owner = by_pixel(self._owner[down, across])
        seen = np.isfinite(height)
        shown = seen & ((owner == group) | (owner == _FREE))
        self.views[window] += seen
        self._height[window] += np.nan_to_num(height)
        light = np.where(shown, remap(cloud.skin, u, v, cv2.INTER_NEAREST), 0)
        self._image[window] += light
        self._seen[window] += light > 0
        if found is None:
            return
        deviation = np.where(shown, remap(found.deviation, u, v, cv2.INTER_NEAREST), np.nan)
        self._deviation[window] += np.nan_to_num(deviation)
        self._squares[window] += np.nan_to_num(deviation) ** 2
        self._weight[window] += np.isfinite(deviation)
        steps = [pose.apply(each.outline) for each in found.others if each.kind == 'step']
        flat = [(self.skin.place(each)[:, :2] - self.low) / PIXEL for each in steps]
        cv2.fillPoly(self._steps, [each.astype(np.int32) for each in flat], 1)
        # Of each cell, at its middle.
        u, v, seen = (_by_cell(each)[..., PIXELS_A_CELL**2 // 2] for each in (u, v, seen))
        findable = np.where(seen, remap(found.findable, u, v, cv2.INTER_NEAREST), np.nan)
        self.findable[down, across] = np.fmin(self.findable[down, across], findable)

    @property
    def image(self) -> NDArray[np.uint8]:
        """Skin, 0 where it was not seen."""
        mean = np.clip(self._image / np.maximum(self._seen, 1), 1, 255)
        return np.where(self._seen > 0, mean, 0).astype(np.uint8)

    @property
    def deviation(self) -> NDArray[np.float32]:
        """Depth below the undeformed contour, metres; NaN where it is not known.

        So it is on a step, and where the clouds' contours contradict each other, as beside it.
        """
        count = np.maximum(self._weight, 1)
        mean = self._deviation / count
        # What the picture of depths may err by, metres: a fifteenth of its scale.
        is_known = (self._weight > 0) & (self._squares / count - mean**2 < 3e-5**2)
        is_known &= self._steps == 0
        return np.where(is_known, mean, np.float32(np.nan))

    def cloud(self) -> Cloud:
        """Middle of each cell, with the skin image as intensity."""
        count, seen, light, total = (
            _by_cell(each).sum(axis=-1)
            for each in (self.views, self._seen, self._image, self._height)
        )
        height = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        middles = self.low + CELL * (np.moveaxis(np.indices(count.shape)[::-1], 0, -1) + 0.5)
        points = self.skin.points(middles, height).astype(np.float32)
        return Cloud(points, light / np.maximum(seen, 1))

    def coverage(self) -> CoverageCells:
        """What was measured, cell by cell."""
        measured = self.measured()
        return CoverageCells(CELL, self.cloud().points[measured], self.findable[measured])

    def measured(self) -> NDArray[np.bool_]:
        """Mask of the cells of which half or more was measured."""
        return _by_cell(self.views > 0).mean(axis=-1) >= 0.5

    @property
    def area(self) -> float:
        """That was measured, by its pixels, square metres."""
        return float(np.count_nonzero(self.views)) * PIXEL**2

    def gaps(self) -> tuple[list[Gap], NDArray[np.bool_]]:
        """What was not measured between what was, as of `find_gaps`."""
        return find_gaps(self.measured(), self.low)


def by_pixel(cells: NDArray) -> NDArray:
    """Values of cells, (rows, columns, ...), at each of their pixels."""
    return cells.repeat(PIXELS_A_CELL, axis=0).repeat(PIXELS_A_CELL, axis=1)


def _by_cell(values: NDArray) -> NDArray:
    """Pixels of each cell, the last axis."""
    rows, columns = (size // PIXELS_A_CELL for size in values.shape)
    parts = values.reshape(rows, PIXELS_A_CELL, columns, PIXELS_A_CELL)
    return parts.transpose(0, 2, 1, 3).reshape(rows, columns, -1)
