"""Messages that no payload sends, for what listens to the payload's topics."""

from __future__ import annotations

import random
from array import array
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.ros.messages import cloud_to_message, image_to_message, make_header

CAMERA, MAP = 'camera_optical_frame', 'map'
TOPICS = {
    'points': PointCloud2,
    'tagged/points': PointCloud2,
    'tagged/pose': PoseWithCovarianceStamped,
    'tagged/camera_pose': PoseWithCovarianceStamped,
    'camera/image_raw': Image,
    'camera/camera_info': CameraInfo,
    'projector/image_raw': Image,
}


def hostile_message(rng: random.Random, stamp_ns: int) -> tuple[str, Any]:
    """Topic and message: malformed, or of something that cannot be."""
    topic = rng.choice(tuple(TOPICS))
    kind = TOPICS[topic]
    if kind is PointCloud2:
        return topic, _cloud(rng, stamp_ns, CAMERA if topic == 'points' else MAP)
    if kind is PoseWithCovarianceStamped:
        return topic, _pose(rng, stamp_ns)
    if kind is CameraInfo:
        return topic, _camera_info(rng, stamp_ns)
    # A sound image of no pattern would say that something else is projected.
    return topic, _image(rng, stamp_ns, malformed=topic.startswith('projector'))


def _cloud(rng: random.Random, stamp_ns: int, frame: str) -> PointCloud2:
    values = np.random.default_rng(rng.getrandbits(32)).normal(0.8, 0.1, (90, 160, 3))
    points = values.astype(np.float32)
    which = rng.randrange(7)
    if which == 0:
        points[:] = 0
    elif which == 1:
        points *= np.float32(1e30)
    elif which == 2:
        points[:] = np.nan
    elif which == 3:
        points[::2] = np.inf
        points[1::2] = 1e9
    message = cloud_to_message(Cloud(points, np.ones((90, 160), np.float32)), stamp_ns, frame)
    if which == 4:
        message.height, message.width, message.data = 2**32 - 1, 0, array('B')
    elif which == 5:
        message.height = message.width = 2**32 - 1
    elif which == 6:
        message.data = message.data[: rng.randrange(1000)]
        message.header.frame_id = 'nowhere'
    return message


def _pose(rng: random.Random, stamp_ns: int) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped(header=make_header(stamp_ns, MAP))
    message.pose.pose.orientation.w = 1.0
    which = rng.randrange(5)
    if which == 0:
        message.pose.pose.position.x = 1e300
    elif which == 1:
        message.pose.pose.position.y = float('nan')
    elif which == 2:
        message.pose.covariance = np.full(36, rng.choice([1e300, -1.0, float('nan')]))
    elif which == 3:
        message.pose.pose.orientation.w = 0.0
    else:
        message.header.frame_id = 'odom'
    return message


def _camera_info(rng: random.Random, stamp_ns: int) -> CameraInfo:
    message = CameraInfo(header=make_header(stamp_ns, CAMERA), width=1280, height=720)
    message.distortion_model = rng.choice(['plumb_bob', 'equidistant', ''])
    message.k = np.array([rng.choice([1e300, -5.0, 1.0]), 0, 1, 0, 900, 1, 0, 0, 1], float)
    message.d = [rng.choice([float('nan'), 1e9, 0.0])] * rng.randrange(9)
    return message


def _image(rng: random.Random, stamp_ns: int, malformed: bool) -> Image:
    generator = np.random.default_rng(rng.getrandbits(32))
    which = rng.randrange(2, 5) if malformed else rng.randrange(5)
    pixels = generator.integers(0, 256, (720, 1280, 3), dtype=np.uint8)
    if which == 1:
        pixels[:] = 0
    message = image_to_message(pixels, stamp_ns, CAMERA)
    if which == 2:
        message.encoding = 'jpeg'
    elif which == 3:
        message.height = 2**32 - 1
    elif which == 4:
        message.data = message.data[:100]
    return message
