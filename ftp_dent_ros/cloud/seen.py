"""A cloud, and what is known of it: where it was seen from, and what was seen besides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.pose import Pose

CAMERA_FRAME = 'camera_optical_frame'


@dataclass(frozen=True, eq=False)
class SeenCloud:
    """A cloud, and what is known of it.

    Attributes
    ----------
    name : str
        Of its file, or its time in a bag.
    cloud : Cloud
        In the camera's frame if `in_camera`, else in `frame_id`.
    stamp_ns : int
        Time of the exposure, ROS time; 0 where it is not known.
    frame_id : str
        ``map`` of tagged clouds and of those with a pose, else the camera's frame.
    in_camera : bool
    pose : Pose, optional
        Of the camera in `frame_id`.
    vehicle : Pose, optional
        Of the camera in `frame_id`, or of ``base_link`` where that alone is known.
    covariance : ndarray, shape (6, 6), optional
        Of that pose; all zeros is unknown.
    coverage : Coverage, optional
        What of the lit skin has no points, and why; the reconstruction knows.
    photograph : ndarray, shape (height, width, 3), uint8, optional
        RGB.
    """

    name: str
    cloud: Cloud
    stamp_ns: int = 0
    frame_id: str = CAMERA_FRAME
    in_camera: bool = True
    pose: Pose | None = None
    vehicle: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    coverage: Coverage | None = None
    photograph: NDArray[np.uint8] | None = None
