"""What of the skin clouds have measured, light enough to be drawn anew while flying.

Each cloud keeps a point every few millimetres, and the coverage is made of all of them where
their cameras are known to have been now: it moves with the survey's corrections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patch import SkinPatch
from ftp_dent_ros.survey.raster import Raster
from ftp_dent_ros.survey.unrolled import CELL, Unrolled, find_gaps


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where a cloud has points, in its camera's frame and in little memory.

    Attributes
    ----------
    middle : ndarray, shape (3,)
        Metres.
    offsets : ndarray, shape (n, 3), float16
        Of the points from it, metres.
    few : ndarray, shape (m, 6), float32
        Some points, metres, and the skin's normals there, towards the camera.
    share : float
        Of a cell, that a point stands for.
    size : float
        Lesser side, metres.
    """

    middle: NDArray[np.float64]
    offsets: NDArray[np.float16]
    few: NDArray[np.float32]
    share: float
    size: float

    @classmethod
    def of(cls, cloud: Cloud, patch: SkinPatch) -> Footprint:
        """Of the points that a cloud has, some on its grid; its patch tells the normals."""
        spacing = np.nanmedian(np.linalg.norm(np.diff(cloud.points[::16], axis=1), axis=-1))
        # How far apart they are, metres: so many in a cell that its rim shows.
        every = max(1, round(0.004 / spacing))
        points = cloud.points[::every, ::every][cloud.valid[::every, ::every]]
        frame, samples = patch.frame, patch.samples.few
        slopes = samples.height_values[::4, 1:3]
        normals = np.column_stack([-slopes, np.ones(len(slopes))])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        # The middle is one of them, however few there are.
        places = frame.apply(np.vstack([np.zeros(3), samples.heights[::4]]))
        normals = frame.rotation.apply(np.vstack([[0.0, 0.0, 1.0], normals]))
        return cls(
            frame.translation,
            (points - frame.translation).astype(np.float16),
            np.hstack([places, normals]).astype(np.float32),
            float(every * spacing / CELL) ** 2,
            min(patch.height.shape) * patch.pitch,
        )


def unrolled(
    footprints: Sequence[Footprint], poses: Sequence[Pose]
) -> tuple[Unrolled, list[NDArray[np.float32]]]:
    """The skin through clouds where their cameras were, and the places of their points on it."""
    both = list(zip(poses, footprints, strict=True))
    few = np.concatenate([pose.apply(each.few[:, :3]) for pose, each in both])
    normals = np.concatenate([pose.rotation.apply(each.few[:, 3:]) for pose, each in both])
    # Some thousands in all tell the skin's form.
    every = max(1, len(few) // 5000)
    # In the map; of a level skin, in the pictures.
    up = np.mean([pose.rotation.apply([0.0, -0.1, 0.0]) for pose in poses], axis=0)
    skin = Unrolled.through(few[::every], normals[::every], up + np.array([0.0, 0.0, 1.0]))
    places = [skin.place(pose.apply(each.middle + each.offsets)) for pose, each in both]
    return skin, [each.astype(np.float32) for each in places]


class SeenSkin(Raster):
    """The cells of the skin that clouds have measured, and the gaps between them.

    Parameters
    ----------
    footprints : sequence of Footprint
    poses : sequence of Pose
        Of the clouds' cameras.

    Raises
    ------
    CloudError
        The clouds are too far apart to draw.

    Attributes
    ----------
    measured : ndarray, shape (rows, columns), bool
    gaps : list of Gap
    gap_mask : ndarray, shape (rows, columns), bool
        Of their cells.
    """

    def __init__(self, footprints: Sequence[Footprint], poses: Sequence[Pose]) -> None:
        skin, by_cloud = unrolled(footprints, poses)
        places = np.concatenate(by_cloud)
        share = np.repeat([each.share for each in footprints], [len(each) for each in by_cloud])
        # A cell of nothing about what was measured.
        low, high = places[:, :2].min(axis=0) - CELL, places[:, :2].max(axis=0) + CELL
        super().__init__(skin, low, high, CELL)
        column, row = np.floor((places[:, :2] - self.low) / CELL).astype(int).T
        at, count = np.ravel_multi_index((row, column), self.shape), math.prod(self.shape)
        # Of a cell, that was measured if the cell was.
        self.measured = np.bincount(at, share, count).reshape(self.shape) >= 0.5
        self.gaps, self.gap_mask = find_gaps(self.measured, self.low)

    @property
    def area(self) -> float:
        """That was measured, square metres."""
        return float(self.measured.sum()) * CELL**2

    def strips(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Corners of the cells of a mask, those side by side along the axis as one, (n, 4, 3).

        On the unrolled skin.
        """
        padded = np.pad(mask.astype(np.int8), ((0, 0), (1, 1)))
        change = np.diff(padded, axis=1)
        row, first = np.nonzero(change == 1)
        _, last = np.nonzero(change == -1)
        corners = [(first, row), (last, row), (last, row + 1), (first, row + 1)]
        flat = np.stack([np.stack(each, axis=-1) for each in corners], axis=1) * CELL + self.low
        return self.skin.points(flat)
