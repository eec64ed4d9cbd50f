"""A cloud with what is known of it, and its dents in another frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.placing import orientation_of
from ftp_dent_ros.pose import Pose

SAME = Pose(Rotation.identity(), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Captured:
    """A cloud, and what is known of it.

    Attributes
    ----------
    name : str
    cloud : Cloud
    stamp_ns : int, optional
    noise : ndarray, shape (rows, columns), optional
        Standard deviation of each point as the reconstruction predicts it, metres.
    viewpoint : ndarray, shape (3,)
        From where it was seen, in its own frame, metres.
    pose : Pose
        Of its frame in the report's.
    vehicle : Pose, optional
        Of the vehicle in the report's frame.
    covariance : ndarray, shape (6, 6), optional
        Of that pose; all zeros is unknown.
    pose_age : float, optional
        Seconds between the cloud and that pose.
    photograph : ndarray, shape (height, width, 3), uint8, optional
        RGB.
    """

    name: str
    cloud: Cloud
    stamp_ns: int | None = None
    noise: NDArray[np.float32] | None = None
    viewpoint: NDArray[np.float64] | tuple[float, float, float] = (0.0, 0.0, 0.0)
    pose: Pose = SAME
    vehicle: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    pose_age: float | None = None
    photograph: NDArray[np.uint8] | None = None


def in_frame(dent: MeasuredDent, pose: Pose) -> MeasuredDent:
    """A dent in the parent frame of `pose`, with its orientation from that frame's x axis."""
    if pose is SAME:
        return dent
    moved = dent.transformed(pose)
    return replace(
        moved,
        orientation=replace(moved.orientation, value=orientation_of(moved.normal, moved.axis)),
    )


def viewpoint_of(cloud: Cloud) -> NDArray[np.float64]:
    """A point on the camera's side of an organised cloud in any frame, shape (3,), metres.

    Columns go right and rows down in the image, so their product points away from the camera.
    """
    points = cloud.points.astype(float)
    with np.errstate(invalid='ignore'):
        away = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    away = away[np.isfinite(away).all(axis=-1)].sum(axis=0)
    length = np.linalg.norm(away)
    valid = points[cloud.valid]
    if not length or not len(valid):
        return np.zeros(3)
    return np.asarray(np.median(valid, axis=0) - away / length, float)
