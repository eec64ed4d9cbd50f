"""What of the skin clouds have measured, light enough to be drawn anew while flying.

Each cloud keeps a sample every few millimetres, and the coverage is made of all of them where
their cameras are known to have been now: it moves with the survey's corrections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.unrolled import Gap, Unrolled, find_gaps

# Side of a cell, and of the squares that a cloud has a sample of, metres.
CELL, _SAMPLE = 0.01, 0.005
# Cells that are drawn at most: poses may put clouds anywhere.
_LARGEST = 1 << 26
# Steps to either side of a footprint's middle, in a number of 16 bits.
_STEPS = 32000
# Points of a footprint by which the skin's form is found; footprints that are drawn at once; and
# what lengths on the skin may be longer than straight ones.
_FEW, _AT_ONCE, _LONGER = 50, 64, 1.1


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where a cloud has points, in its camera's frame and in little memory.

    Attributes
    ----------
    steps : ndarray, shape (n, 3), int16
        From the middle on.
    middle : ndarray, shape (3,)
        Metres.
    step : float
        Metres.
    normal : ndarray, shape (3,)
        Of the plane through the cloud, towards the camera.
    """

    steps: NDArray[np.int16]
    middle: NDArray[np.float64]
    step: float
    normal: NDArray[np.float64]

    @classmethod
    def of(cls, cloud: Cloud) -> Footprint:
        """A mean point of each square of the plane through a cloud that it has measured."""
        # Points a side of a square that are enough, and of how many rows one tells how far apart
        # they are.
        apart = np.linalg.norm(np.diff(cloud.points[::16], axis=1), axis=-1)
        apart = apart[apart > 0]
        every = max(1, int(_SAMPLE / 2.5 / np.median(apart))) if len(apart) else 1
        thinned = slice(None, None, every), slice(None, None, every)
        points = cloud.points[thinned][cloud.valid[thinned]].astype(float)
        middle = points.mean(axis=0)
        some = points[:: max(1, len(points) // 1000)] - middle
        _, _, axes = np.linalg.svd(some, full_matrices=False)
        square = np.floor((points - middle) @ axes[:2].T / _SAMPLE).astype(np.int64)
        square -= square.min(axis=0)
        at = square[:, 0] * (square[:, 1].max() + 1) + square[:, 1]
        count = np.bincount(at)
        # Less than half a square at the rim is none.
        full = np.flatnonzero(count >= np.median(count[count > 0]) / 2)
        mean = np.stack([np.bincount(at, each)[full] for each in points.T], axis=-1)
        # Towards the camera.
        normal = axes[2] * (-1 if axes[2] @ middle > 0 else 1)
        off = mean / count[full, None] - middle
        step = max(float(np.abs(off).max(initial=0.0)), 1e-3) / _STEPS
        return cls(np.rint(off / step).astype(np.int16), middle, step, normal)

    def points(self, every: int = 1) -> NDArray[np.float64]:
        """Every so many-th of the points, shape (m, 3), metres."""
        return self.middle + self.step * self.steps[::every]

    @property
    def reach(self) -> float:
        """What no point is farther from the middle than along any axis, metres."""
        return self.step * _STEPS


@dataclass(frozen=True, eq=False)
class SeenSkin:
    """The cells that were measured, and the gaps between them.

    Attributes
    ----------
    skin : Unrolled
    low : ndarray, shape (2,)
        x and y of the first cell's corner, metres.
    measured : ndarray, shape (rows, columns), bool
    height : ndarray, shape (rows, columns)
        Of the cells above the unrolled skin, metres; the nearest one's where none was measured.
    gaps : list of Gap
    """

    skin: Unrolled
    low: NDArray[np.float64]
    measured: NDArray[np.bool_]
    height: NDArray[np.float64]
    gaps: list[Gap]

    @property
    def area(self) -> float:
        """That was measured, square metres."""
        return float(self.measured.sum()) * CELL**2

    def strips(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Corners of the cells of a mask, those side by side along the axis as one, (n, 4, 3)."""
        padded = np.pad(mask.astype(np.int8), ((0, 0), (1, 1)))
        change = np.diff(padded, axis=1)
        row, first = np.nonzero(change == 1)
        _, last = np.nonzero(change == -1)
        sums = np.pad(self.height.cumsum(axis=1), ((0, 0), (1, 0)))
        height = (sums[row, last] - sums[row, first]) / np.maximum(last - first, 1)
        corners = [(first, row), (last, row), (last, row + 1), (first, row + 1)]
        flat = np.stack([np.stack(each, axis=-1) for each in corners], axis=1) * CELL + self.low
        return self.skin.points(flat, np.repeat(height[:, None], 4, axis=1))

    def gap_mask(self) -> NDArray[np.bool_]:
        """Mask of the cells of all gaps."""
        mask = np.zeros_like(self.measured)
        for gap in self.gaps:
            mask[tuple(gap.cells.T)] = True
        return mask


def seen_skin(footprints: Sequence[Footprint], poses: Sequence[Pose]) -> SeenSkin | None:
    """Coverage of clouds where their cameras were; None where that is too far apart to draw."""
    both = list(zip(poses, footprints, strict=True))
    few = [pose.apply(each.points(max(1, len(each.steps) // _FEW))) for pose, each in both]
    normals = np.stack([pose.rotation.apply(each.normal) for pose, each in both])
    repeated = np.repeat(normals, [len(each) for each in few], axis=0)
    skin = Unrolled.through(np.concatenate(few), repeated)
    middles = skin.place(np.stack([pose.apply(each.middle) for pose, each in both]))[:, :2]
    reach = _LONGER * np.sqrt(3) * np.array([[each.reach] for each in footprints])
    low = (np.floor((middles - reach).min(axis=0) / CELL) - 1) * CELL
    columns, rows = np.floor(((middles + reach).max(axis=0) - low) / CELL).astype(int) + 2
    if columns * rows > _LARGEST:
        return None
    covered, height = (np.zeros(rows * columns) for _ in range(2))
    for start in range(0, len(both), _AT_ONCE):
        some = both[start : start + _AT_ONCE]
        place = skin.place(np.concatenate([pose.apply(each.points()) for pose, each in some]))
        # A square lies on up to four cells: their shares of it, along each axis.
        corner = (place[:, :2] - low - _SAMPLE / 2) / CELL
        first = np.floor(corner).astype(np.int64)
        # Poses that contradict each other have no one skin: on it some points lie far off.
        inside = ((first >= 0) & (first < (columns - 1, rows - 1))).all(axis=1)
        if not inside.any():
            continue
        place, corner, first = place[inside], corner[inside], first[inside]
        beyond = np.maximum(corner - first + _SAMPLE / CELL - 1, 0)
        within = _SAMPLE / CELL - beyond
        for right, up in ((0, 0), (1, 0), (0, 1), (1, 1)):
            share = (beyond if right else within)[:, 0] * (beyond if up else within)[:, 1]
            at = (first[:, 1] + up) * columns + first[:, 0] + right
            begin, end = at.min(), at.max() + 1
            covered[begin:end] += np.bincount(at - begin, share)
            height[begin:end] += np.bincount(at - begin, share * place[:, 2])
    covered, height = covered.reshape(rows, columns), height.reshape(rows, columns)
    # A cell of nothing about what is covered.
    inside = [np.flatnonzero(covered.any(axis=1 - axis)) for axis in (0, 1)]
    down, across = (slice(max(each[0] - 1, 0), each[-1] + 2) for each in inside)
    low = low + CELL * np.array([across.start, down.start])
    covered, height = covered[down, across], height[down, across]
    # Of a cell, that was measured if the cell was.
    measured = covered >= 0.5
    height = height / np.maximum(covered, 1e-9)
    # Of what was not measured, that of the nearest that was.
    nearest = distance_transform_edt(~measured, return_distances=False, return_indices=True)
    return SeenSkin(skin, low, measured, height[tuple(nearest)], find_gaps(measured, low, CELL))
