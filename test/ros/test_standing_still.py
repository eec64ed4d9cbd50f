"""A node whose process stood still goes on, whatever the transport made of it meanwhile."""

from __future__ import annotations

import signal
import socket
import time

import numpy as np
from descriptors import own_ports
from geometry_msgs.msg import PoseWithCovarianceStamped
from hovering_autopilot import HoveringAutopilot, Wire
from rclpy.clock import Clock
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.ros.messages import cloud_to_message, stamp_to_ns
from ftp_dent_ros.ros.qos import CLOUDS, POSES
from ftp_dent_ros.supervision import hearing

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


def test_a_process_whose_port_is_gone_is_known_for_it(ros):
    node = ros.start('pattern_publisher', pattern='shipped:pattern.yaml')
    ros.until(ros.diagnostics('pattern_publisher'))
    assert not hearing.is_cut_off(node.pid)
    ports = own_ports(node.pid)
    assert ports
    for path in ports:
        path.unlink()
    assert hearing.is_cut_off(node.pid)
    assert not hearing.is_cut_off(2**22 + 1)  # above the kernel's largest number of a process


def test_a_port_that_is_out_of_reach_for_a_moment_is_no_loss(monkeypatch):
    seconds = [0.0]
    gone = [False]
    monkeypatch.setattr(hearing, 'ports', lambda: frozenset([('fastrtps_port1', int(gone[0]))]))
    watch = hearing.Hearing(lambda: seconds[0], lambda: gone[0])

    def lost_by(end: float) -> bool:
        said = []
        while seconds[0] < end:
            seconds[0] += 0.2
            said.append(watch.is_lost())
        return any(said)

    assert not lost_by(10.0)
    gone[0] = True
    assert not lost_by(11.9)
    gone[0] = False
    assert not lost_by(20.0)
    gone[0] = True
    assert lost_by(24.5)
