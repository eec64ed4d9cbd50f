"""A cloud, and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.pose import Pose

SAME = Pose(Rotation.identity(), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Observation:
    """A cloud, and what is known of it.

    Attributes
    ----------
    name : str
    cloud : Cloud
    stamp_ns : int, optional
    viewpoint : ndarray, shape (3,)
        From where it was seen, in its own frame, metres.
    pose : Pose
        Of its frame in the report's.
    vehicle : Pose, optional
        Of the camera in the report's frame, or of the vehicle where that alone is known.
    covariance : ndarray, shape (6, 6), optional
        Of that pose; all zeros is unknown.
    pose_age : float, optional
        Seconds between the cloud and that pose.
    coverage : Coverage, optional
        What of the lit skin has no points, and why; the reconstruction knows.
    photograph : ndarray, shape (height, width, 3), uint8, optional
        RGB.
    """

    name: str
    cloud: Cloud
    stamp_ns: int | None = None
    viewpoint: NDArray[np.float64] | tuple[float, float, float] = (0.0, 0.0, 0.0)
    pose: Pose = SAME
    vehicle: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    pose_age: float | None = None
    coverage: Coverage | None = None
    photograph: NDArray[np.uint8] | None = None


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
