"""A rigid pose: where one frame is, seen from another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Pose:
    """Pose of a child frame in a parent frame; maps child coordinates to parent coordinates.

    Attributes
    ----------
    rotation : scipy.spatial.transform.Rotation
        Rotates vectors of the child frame into the parent frame.
    translation : ndarray, shape (3,)
        Origin of the child frame in the parent frame, metres.
    """

    rotation: Rotation
    translation: NDArray[np.float64]

    @classmethod
    def from_quaternion(cls, quaternion: ArrayLike, translation: ArrayLike) -> Pose:
        """Pose from a quaternion (x, y, z, w), as in geometry_msgs, and a translation."""
        return cls(Rotation.from_quat(quaternion), np.asarray(translation, float))

    @classmethod
    def from_rpy(cls, rpy: ArrayLike, translation: ArrayLike) -> Pose:
        """Pose from roll, pitch, yaw (radians, fixed axes x, y, z: REP 103) and a translation."""
        return cls(Rotation.from_euler('xyz', rpy), np.asarray(translation, float))

    @property
    def quaternion(self) -> NDArray[np.float64]:
        """Quaternion (x, y, z, w) of the rotation."""
        return self.rotation.as_quat()

    def apply(self, points: NDArray) -> NDArray:
        """Transform points of shape (..., 3) from the child to the parent frame.

        The computation is in double precision; the result has the type of `points`.
        """
        moved = np.asarray(points, float) @ self.rotation.as_matrix().T + self.translation
        return moved.astype(points.dtype, copy=False)

    def __matmul__(self, other: Pose) -> Pose:
        """Chain: ``(a_from_b @ b_from_c)`` is a from c."""
        return Pose(
            self.rotation * other.rotation,
            self.rotation.apply(other.translation) + self.translation,
        )

    def inverse(self) -> Pose:
        """Pose of the parent frame in the child frame."""
        rotation = self.rotation.inv()
        return Pose(rotation, -rotation.apply(self.translation))


#: Of a frame in itself.
IDENTITY = Pose(Rotation.identity(), np.zeros(3))
