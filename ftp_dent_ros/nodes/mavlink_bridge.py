"""The autopilot's pose for every cloud.

Keeps a MAVLink link, publishes the autopilot's poses on ``mavlink/pose``, and for each cloud on
``points`` the same cloud in the map frame on ``tagged/points`` and the pose at exactly its stamp
on ``tagged/pose``. A cloud waits, without holding anything up, until all that its pose depends on
has been heard; a pose that cannot be had is counted and logged with its reason, and nothing is
published in its place.
"""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.errors import CloudError, PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import accuracy
from ftp_dent_ros.navigation.accuracy import Covariance, Tag
from ftp_dent_ros.navigation.codec import read_key
from ftp_dent_ros.navigation.link import Link
from ftp_dent_ros.navigation.report import Verdict, figures, judge
from ftp_dent_ros.navigation.vehicle_state import Settings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    cloud_to_message,
    make_header,
    pose_stamped_message,
    pose_to_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import CLOUDS, OVERRIDABLE, POSES
from ftp_dent_ros.ros.transforms import TransformPublisher

_CHECK_PERIOD = 0.1
_LEVELS = {'ok': OK, 'warning': WARN, 'error': ERROR}


@dataclass(frozen=True)
class _Waiting:
    """A cloud that waits for its pose; arrival in seconds of steady time."""

    message: PointCloud2
    stamp: int
    arrival: float


class MavlinkBridge(Node):
    """Node that tags clouds with the autopilot's pose."""

    def __init__(self, **options: Any) -> None:
        super().__init__('mavlink_bridge', **options)
        parameters = Parameters(self)
        address = parameters.declare(
            'address',
            'udpin:127.0.0.1:14550',
            'The autopilot: udpin:HOST:PORT (listens; on 127.0.0.1 without HOST), '
            'udpout:HOST:PORT (sends first), tcp:HOST:PORT, or the path of a serial device.',
        )
        baud = parameters.declare(
            'baud', 921600, 'Baud rate of a serial device.', minimum=1200, maximum=4_000_000
        )
        settings = _declare_settings(parameters)
        key_file = parameters.declare(
            'signing_key',
            '',
            'File with the key of MAVLink signing, 32 bytes or 64 hexadecimal digits; what is not '
            'signed with it is refused. Without it nothing is signed.',
        )
        signing_key = read_key(key_file) if key_file else b''
        self._timeout = parameters.declare(
            'pose_timeout',
            1.0,
            'How long a cloud waits for its pose, seconds.',
            minimum=0.0,
            maximum=60.0,
            changeable=True,
        )
        self._most_waiting = parameters.declare(
            'queue_size', 5, 'How many clouds may wait at once.', minimum=1, maximum=1000
        )
        self._map, self._base, self._camera = _declare_frames(parameters)
        self._mount, self._mount_covariance = _declare_mount(parameters)
        publishes_tf = parameters.declare(
            'publish_tf', True, 'Whether poses and mount also go to TF, where tf2_msgs exists.'
        )
        parameters.on_change(self._change)
        self._address = address
        self._waiting: deque[_Waiting] = deque()
        self._said: Verdict | None = None
        self._poses = self.create_publisher(PoseStamped, 'mavlink/pose', POSES)
        self._tagged_pose = self.create_publisher(PoseWithCovarianceStamped, 'tagged/pose', POSES)
        self._tagged_points = self.create_publisher(
            PointCloud2, 'tagged/points', CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._transforms = TransformPublisher(self) if publishes_tf else None
        if self._transforms is not None:
            self._transforms.publish_static(self._mount, self._base, self._camera, self._now_ns())
        self._diagnostics = Diagnostics(self, self._judge, hardware_id=address)
        self.create_subscription(
            PointCloud2, 'points', self._on_points, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._news = self.create_guard_condition(self._settle)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_CHECK_PERIOD, self._settle, clock=steady)
        self.create_timer(1.0, self._send_heartbeat, clock=steady)
        # Last, for its thread must not be left behind if something above fails.
        self._link = Link(address, baud, settings, self._now_ns, self._on_link_poses, signing_key)

    def destroy_node(self) -> None:
        """Close the link first."""
        self._link.close()
        super().destroy_node()

    def _change(self, values: dict[str, Any]) -> None:
        self._timeout = values.get('pose_timeout', self._timeout)

    def _send_heartbeat(self) -> None:
        self._link.send_heartbeat()

    def _on_link_poses(self, poses: list[tuple[int, Pose]]) -> None:
        """Publish, in the link's thread: fifty wake-ups a second of an executor are dear."""
        for stamp, pose in poses:
            self._diagnostics.count('poses')
            self._poses.publish(pose_stamped_message(pose, stamp, self._map))
            if self._transforms is not None:
                self._transforms.publish(pose, self._map, self._base, stamp)
        if self._waiting:
            self._news.trigger()

    def _on_points(self, message: PointCloud2) -> None:
        self._diagnostics.count('clouds')
        frame = message.header.frame_id
        if frame != self._camera:
            self._diagnostics.refuse(
                'wrong frame',
                f'the cloud is in the frame {frame!r}, but the mount is that of {self._camera!r}: '
                'set camera_frame',
            )
            return
        stamp = stamp_to_ns(message.header.stamp)
        if len(self._waiting) >= self._most_waiting:
            late = self._waiting.popleft()
            self._refuse(late, 'too many waiting', f'{self._most_waiting} clouds wait already')
        self._waiting.append(_Waiting(message, stamp, time.monotonic()))
        self._settle()

    def _settle(self) -> None:
        """Tag or refuse each waiting cloud for which that can be said by now."""
        for _ in range(len(self._waiting)):
            cloud = self._waiting.popleft()
            try:
                tag = self._link.tag_at(cloud.stamp)
            except PoseAwaitedError as error:
                if time.monotonic() - cloud.arrival < self._timeout:
                    self._waiting.append(cloud)
                else:
                    waited = f'after {self._timeout:g} s: {error}'
                    self._refuse(cloud, error.reason, waited)
            except PoseError as error:
                self._refuse(cloud, error.reason, str(error))
            else:
                self._tag(cloud, tag)

    def _tag(self, cloud: _Waiting, tag: Tag) -> None:
        header = make_header(cloud.stamp, self._map)
        if self._tagged_points.get_subscription_count():
            try:
                points = cloud_from_message(cloud.message)
            except CloudError as error:
                self._diagnostics.refuse('wrong cloud', str(error))
                return
            in_map = points.transformed(tag.pose @ self._mount)
            self._tagged_points.publish(cloud_to_message(in_map, cloud.stamp, self._map))
        covariance = tag.covariance + self._mount_covariance
        message = PoseWithCovarianceStamped(header=header)
        message.pose.pose = pose_to_message(tag.pose)
        message.pose.covariance = covariance.ravel()
        self._tagged_pose.publish(message)
        self._diagnostics.count('tagged')
        deviations = np.sqrt(np.diag(covariance))
        self._diagnostics.note('tag within (mm)', f'{1e3 * deviations[:3].max():.0f}')
        self._diagnostics.note('tag within (deg)', f'{np.degrees(deviations[3:].max()):.2f}')
        self._diagnostics.measure('waited', time.monotonic() - cloud.arrival)

    def _refuse(self, cloud: _Waiting, reason: str, sentence: str) -> None:
        age = (self._now_ns() - cloud.stamp) / 1e9
        self._diagnostics.refuse(
            reason,
            f'no pose for the cloud of {cloud.stamp / 1e9:.3f} ({age:.1f} s ago): {sentence}',
        )

    def _judge(self) -> tuple[bytes, str]:
        state = self._link.state()
        for name, value in figures(state).items():
            self._diagnostics.note(name, value)
        self._diagnostics.note('clouds waiting', len(self._waiting))
        verdict = judge(state, self._address)
        if verdict != self._said:
            self._said = verdict
            # One line a severity: rclpy ties a severity to the line that logs.
            if verdict.severity == 'ok':
                self.get_logger().info(verdict.text)
            elif verdict.severity == 'warning':
                self.get_logger().warning(verdict.text)
            else:
                self.get_logger().error(verdict.text)
        return _LEVELS[verdict.severity], verdict.text

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def _declare_settings(parameters: Parameters) -> Settings:
    """Whom to believe and what to ask for, from parameters."""
    default = Settings()
    return Settings(
        system_id=parameters.declare(
            'system_id',
            default.system_id,
            'MAVLink system id of the autopilot; 0 for the first that is heard.',
            minimum=0,
            maximum=255,
        ),
        component_id=parameters.declare(
            'component_id',
            default.component_id,
            'MAVLink component id of the autopilot.',
            minimum=1,
            maximum=255,
        ),
        rate=parameters.declare(
            'rate',
            default.rate,
            'Rate at which attitude and position are asked for, Hz.',
            minimum=10.0,
            maximum=200.0,
        ),
        maximum_gap=parameters.declare(
            'maximum_gap',
            default.maximum_gap,
            'Longest time between two samples across which a pose is interpolated, seconds.',
            minimum=0.01,
            maximum=1.0,
        ),
        maximum_clock_error=parameters.declare(
            'maximum_clock_error',
            default.maximum_clock_error,
            "Largest uncertainty of the autopilot's clock at which a cloud is tagged, seconds.",
            minimum=0.0001,
            maximum=1.0,
        ),
    )


def _declare_frames(parameters: Parameters) -> tuple[str, str, str]:
    """Names of the map, the base and the camera frame, from parameters."""
    return (
        parameters.declare('map_frame', 'map', "The map: ENU about the estimator's origin."),
        parameters.declare('base_frame', 'base_link', "The vehicle's body: FLU."),
        parameters.declare(
            'camera_frame', 'camera_optical_frame', 'The frame that clouds come in.'
        ),
    )


def _declare_mount(parameters: Parameters) -> tuple[Pose, Covariance]:
    """Pose of the camera on the vehicle and its covariance; by default it looks forward."""
    translation = parameters.declare(
        'mount.translation',
        [0.1, 0.0, 0.0],
        'Position of the camera in the base frame: forward, left, up, metres.',
        minimum=-100.0,
        maximum=100.0,
    )
    rpy = parameters.declare(
        'mount.rpy',
        [-math.pi / 2, 0.0, -math.pi / 2],
        "Roll, pitch, yaw of the camera's optical frame in the base frame, radians.",
        minimum=-2 * math.pi,
        maximum=2 * math.pi,
    )
    uncertainty = accuracy.of_mount(
        parameters.declare(
            'mount.translation_uncertainty',
            0.005,
            'Standard deviation of mount.translation along each axis, metres.',
            minimum=0.0,
            maximum=100.0,
        ),
        parameters.declare(
            'mount.rotation_uncertainty',
            0.01,
            'Standard deviation of mount.rpy about each axis, radians.',
            minimum=0.0,
            maximum=math.pi,
        ),
    )
    return Pose.from_rpy(rpy, translation), uncertainty


def main() -> int:
    """Run the node as a process."""
    return run(MavlinkBridge, 'mavlink_bridge')


if __name__ == '__main__':
    sys.exit(main())
