"""Poses with their covariances, as the bridge publishes them."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped

from ftp_dent_ros.ros.messages import make_header, pose_to_message


def located(stamp_ns, pose, covariance, frame_id='map') -> PoseWithCovarianceStamped:
    """Message of a pose, or of the message of one."""
    content = pose_to_message(pose) if hasattr(pose, 'translation') else pose
    tag = PoseWithCovariance(pose=content, covariance=np.ravel(covariance))
    return PoseWithCovarianceStamped(header=make_header(stamp_ns, frame_id), pose=tag)
