"""A node whose process stood still goes on, whatever the transport made of it meanwhile."""

from __future__ import annotations

import signal
import socket
import time

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from hovering_autopilot import HoveringAutopilot, Wire
from rclpy.clock import Clock
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.ros.messages import cloud_to_message, stamp_to_ns
from ftp_dent_ros.ros.qos import CLOUDS, POSES

STOPPED = 6.0  # seconds, several times what Fast DDS waits for a reader
PERIOD = 0.5


def test_a_node_that_stood_still_gets_its_clouds_again(ros):
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(('127.0.0.1', 0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    y, x = np.mgrid[:360, :640].astype(np.float32) / 1000
    cloud = Cloud(np.dstack([x, y, np.ones_like(x)]), np.zeros_like(x))
    message = cloud_to_message(cloud, 0, 'camera_optical_frame')
    with HoveringAutopilot(Wire(end, ('127.0.0.1', port))):
        node = ros.start('mavlink_bridge', address=f'udpin:127.0.0.1:{port}', pose_timeout=0.2)
        tags = ros.collect(PoseWithCovarianceStamped, 'tagged/pose', POSES)
        clouds = ros.publisher(PointCloud2, 'points', CLOUDS)
        due = 0.0

        def is_tagged_after(stamp_ns: int) -> bool:
            """Publish a cloud now and then; whether one that was taken later has its pose."""
            nonlocal due
            if time.monotonic() > due:
                due = time.monotonic() + PERIOD
                message.header.stamp = Clock().now().to_msg()
                clouds.publish(message)
            return bool(tags) and stamp_to_ns(tags[-1].header.stamp) > stamp_ns

        ros.until(lambda: is_tagged_after(0))
        node.send(signal.SIGSTOP)
        on = time.monotonic() + STOPPED
        ros.until(lambda: is_tagged_after(0) and time.monotonic() > on)
        node.send(signal.SIGCONT)
        now_ns = Clock().now().nanoseconds
        ros.until(lambda: is_tagged_after(now_ns), timeout=30.0)
