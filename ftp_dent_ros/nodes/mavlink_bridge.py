"""The autopilot's pose for every cloud.

Keeps a MAVLink link, publishes the autopilot's poses on ``mavlink/pose``, and for each cloud on
``points`` the same cloud in the map frame on ``tagged/points``, its every n-th point on
``tagged/preview`` for those in the network, and the poses at exactly its stamp, of the vehicle on
``tagged/pose``, of the camera on ``tagged/camera_pose``. A cloud waits, without
holding anything up, until all that its pose depends on has been heard; a pose that cannot be had
is counted and logged with its reason, and nothing is published in its place.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import NavSatFix, PointCloud2

from ftp_dent_ros.errors import CloudError, PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.link import Link
from ftp_dent_ros.navigation.origin import Origin
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.navigation.report import Verdict
from ftp_dent_ros.nodes.bridge_camera import BridgeCamera
from ftp_dent_ros.nodes.bridge_parameters import declare
from ftp_dent_ros.nodes.bridge_tags import BridgeTags
from ftp_dent_ros.nodes.declarations import names_of_all
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from ftp_dent_ros.ros.messages import fix_message, pose_stamped_message, stamp_to_ns
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED, OVERRIDABLE, POSES
from ftp_dent_ros.ros.transforms import TransformPublisher

# Seconds between two looks at which clouds have their poses.
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
        given = declare(parameters)
        parameters.close(names_of_all)
        address, settings = given.address, given.settings
        self._earth = None
        if settings.earth:
            self._earth = self.create_publisher(NavSatFix, 'earth', LATCHED)
        self._origin: Origin | None = None
        self._timeout, self._most_waiting = given.timeout, given.most_waiting
        self._map, self._base, self._camera = (
            given.map_frame,
            given.base_frame,
            given.camera_frame,
        )
        self._mount, self._mount_covariance = given.mount, given.mount_covariance
        parameters.on_change(self._change)
        self._address = address
        self._waiting: deque[_Waiting] = deque()
        self._said: Verdict | None = None
        self._poses = self.create_publisher(PoseStamped, 'mavlink/pose', POSES)
        self._transforms = TransformPublisher(self) if given.publishes_tf else None
        if self._transforms is not None:
            self._transforms.publish_static(self._mount, self._base, self._camera, self._now_ns())
        self._diagnostics = Diagnostics(self, self._judge, hardware_id=address)
        self._tags = BridgeTags(
            self,
            self._map,
            self._mount,
            self._mount_covariance,
            self._most_waiting,
            given.preview_columns,
            self._diagnostics,
        )
        self.create_subscription(
            PointCloud2, 'points', self._on_points, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._news = self.create_guard_condition(self._settle)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_CHECK_PERIOD, self._settle, clock=steady)
        self.create_timer(1.0, self._send_heartbeat, clock=steady)
        station, size = given.ground_station, given.image_size
        self._mavlink_camera = (
            BridgeCamera(self, station, self._mount, size, self._diagnostics) if station else None
        )
        # Of each photograph it is told where on the earth it was taken.
        settings = replace(settings, earth=settings.earth or bool(station))
        # Last, for its thread must not be left behind if something above fails.
        self._link = Link(
            address,
            given.baud,
            settings,
            self._now_ns,
            self._on_link_poses,
            given.signing_key,
            self._on_link_command,
        )

    def destroy_node(self) -> None:
        """Close the link first."""
        self._link.close()
        super().destroy_node()

    def _change(self, values: dict[str, Any]) -> None:
        self._timeout = values.get('pose_timeout', self._timeout)

    def _send_heartbeat(self) -> None:
        self._link.send_heartbeat()
        if self._mavlink_camera is not None:
            self._mavlink_camera.send_heartbeat(self._link)

    def _on_link_poses(self, poses: list[tuple[int, Pose]]) -> None:
        """Publish, in the link's thread: fifty wake-ups a second of an executor are dear."""
        for stamp, pose in poses:
            self._diagnostics.count('poses')
            self._poses.publish(pose_stamped_message(pose, stamp, self._map))
            if self._transforms is not None:
                self._transforms.publish(pose, self._map, self._base, stamp)
        if self._waiting:
            self._news.trigger()

    def _on_link_command(self, command: Any) -> None:
        if self._mavlink_camera is not None:
            self._mavlink_camera.take(command)
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
        self._waiting.append(_Waiting(message, stamp, time.monotonic()))
        self._settle()
        while len(self._waiting) > self._most_waiting:
            self._refuse_crowded(self._waiting.popleft())

    def _settle(self) -> None:
        """Tag or refuse each waiting cloud for which that can be said by now."""
        if self._mavlink_camera is not None:
            self._mavlink_camera.settle(self._link, self._now_ns(), self._timeout)
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
        try:
            self._tags.publish(cloud.message, cloud.stamp, tag)
        except CloudError as error:
            self._diagnostics.refuse('wrong cloud', str(error))
            return
        self._diagnostics.measure('waited', time.monotonic() - cloud.arrival)

    def _refuse_crowded(self, cloud: _Waiting) -> None:
        """Refuse one for which there is no room any more, with what it has waited for."""
        try:
            self._tag(cloud, self._link.tag_at(cloud.stamp))
        except PoseError as error:
            waited = time.monotonic() - cloud.arrival
            crowd = f'after {waited:.1f} s, and {self._most_waiting} clouds wait behind it'
            self._refuse(cloud, error.reason, f'{crowd} (queue_size): {error}')

    def _refuse(self, cloud: _Waiting, reason: str, sentence: str) -> None:
        age = (self._now_ns() - cloud.stamp) / 1e9
        self._diagnostics.refuse(
            reason,
            f'no pose for the cloud of {cloud.stamp / 1e9:.3f} ({age:.1f} s ago): {sentence}',
        )

    def _judge(self) -> tuple[bytes, str]:
        state = self._link.state()
        for name, value in state.figures.items():
            self._diagnostics.note(name, value)
        self._diagnostics.note('clouds waiting', len(self._waiting))
        self._follow_origin(state.origin)
        verdict = state.verdict
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

    def _follow_origin(self, origin: Origin | None) -> None:
        # Compared as text, for an altitude that is not known differs from itself.
        if origin is None or repr(origin) == repr(self._origin):
            return
        if self._origin is not None:
            self._diagnostics.refuse(
                'moved map',
                f"the map's origin has moved by {origin.distance(self._origin):.2f} m: clouds of "
                'before and after do not lie together, take the list of dents and begin anew',
            )
        self._origin = origin
        if self._earth is not None:
            self._earth.publish(fix_message(origin, self._now_ns(), self._map))

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def main() -> int:
    """Run the node as a process."""
    return run(MavlinkBridge, 'mavlink_bridge')


if __name__ == '__main__':
    sys.exit(main())
