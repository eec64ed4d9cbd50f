"""The autopilot's pose for every cloud, and the payload as a MAVLink camera.

Keeps a MAVLink link, publishes the autopilot's poses on ``mavlink/pose``, and for each cloud on
``points`` the same cloud in the map frame on ``tagged/points``, its every n-th point on
``tagged/preview`` for those in the network, and the poses at exactly its stamp, of the vehicle on
``tagged/pose``, of the camera on ``tagged/camera_pose``. A cloud waits, without holding anything
up, until all that its pose depends on has been heard; a pose that cannot be had is counted and
logged with its reason, and nothing is published in its place.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Transform, TransformStamped
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo, NavSatFix, NavSatStatus, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import thinned
from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import pose_covariance
from ftp_dent_ros.navigation.camera import COMPONENT, Camera
from ftp_dent_ros.navigation.link import Link
from ftp_dent_ros.navigation.origin import Origin
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import MavlinkBridgeSettings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    cloud_to_message,
    covariant_pose_message,
    make_header,
    pose_stamped_message,
    pose_to_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, LATCHED, OVERRIDABLE, POSES, PREVIEWS

_LEVELS = {'ok': OK, 'warning': WARN, 'error': ERROR}


try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None


def transform_message(pose: Pose, parent: str, child: str, stamp_ns: int) -> TransformStamped:
    """geometry_msgs/TransformStamped of the pose of a child frame in its parent."""
    message = pose_to_message(pose)
    transform = Transform(rotation=message.orientation)
    transform.translation.x = message.position.x
    transform.translation.y = message.position.y
    transform.translation.z = message.position.z
    return TransformStamped(
        header=make_header(stamp_ns, parent), child_frame_id=child, transform=transform
    )


class TransformPublisher:
    """Publishes on ``/tf`` and ``/tf_static``; does nothing where TF is not installed."""

    def __init__(self, node: Node) -> None:
        self._publishers: dict[bool, Publisher] = {}
        if TFMessage is not None:
            # As tf2_ros has them.
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            moving = node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100))
            fixed = node.create_publisher(TFMessage, '/tf_static', latched)
            self._publishers = {False: moving, True: fixed}

    def publish(
        self, pose: Pose, parent: str, child: str, stamp_ns: int, static: bool = False
    ) -> None:
        """Publish a pose, that never changes if it is `static`."""
        if self._publishers:
            message = transform_message(pose, parent, child, stamp_ns)
            self._publishers[static].publish(TFMessage(transforms=[message]))


@dataclass(frozen=True, eq=False)
class Waiting:
    """A cloud or the telling of an image that waits for its pose.

    Attributes
    ----------
    message : sensor_msgs/PointCloud2 or sensor_msgs/CameraInfo
    stamp : int
        Nanoseconds.
    arrival : float
        Seconds of steady time.
    """

    message: Any
    stamp: int
    arrival: float

    @staticmethod
    def of(message: Any) -> Waiting:
        """A message that has just come."""
        return Waiting(message, stamp_to_ns(message.header.stamp), time.monotonic())


def settled(
    waiting: deque[Waiting], link: Link, timeout: float
) -> Iterator[tuple[Waiting, Tag | PoseError]]:
    """Take out what has its pose by now, or why there will be none, at the latest after a time."""
    for _ in range(len(waiting)):
        each = waiting.popleft()
        try:
            found: Tag | PoseError = link.tag_at(each.stamp)
        except PoseError as error:
            is_young = time.monotonic() - each.arrival < timeout
            if is_young and isinstance(error, PoseAwaitedError):
                waiting.append(each)
                continue
            found = error
        yield each, found


class BridgeCamera:
    """Commands from the link become calls of ``camera_capture/capture``, images become messages.

    All but `take` runs in the executor, so that a node that is stuck answers nothing.
    """

    def __init__(
        self,
        node: MavlinkBridge,
        mount: Pose,
    ) -> None:
        self._mount, self._diagnostics = mount, node.diagnostics
        self._camera = Camera(node.given.ground_station, self._shoot)
        rig = node.given.rig
        self._size = self._sent_size = (rig.camera.width, rig.camera.height) if rig else (0, 0)
        self._commands: deque[Any] = deque(maxlen=20)
        self._images: deque[Waiting] = deque(maxlen=20)
        self._failures = 0
        self._client = node.create_client(Trigger, 'camera_capture/capture')
        node.create_subscription(
            CameraInfo,
            'camera/camera_info',
            self._on_camera_info,
            IMAGES,
            qos_overriding_options=OVERRIDABLE,
        )

    def take(self, command: Any) -> None:
        """Keep a command for `settle`; from any thread."""
        self._commands.append(command)

    def send_heartbeat(self, link: Link) -> None:
        """Tell that there is a camera."""
        link.send_heartbeat(mavlink.MAV_TYPE_CAMERA, COMPONENT)

    def settle(self, link: Link, now_ns: int, timeout: float) -> None:
        """Answer what can be answered by now."""
        send: Callable[[Any], None] = lambda message: link.send(message, COMPONENT)  # noqa: E731
        has_news = self._commands or self._images or self._size != self._sent_size
        state = link.state() if has_news else None
        if state is None or state.identity is None:
            return
        offset = state.clock_offset
        boot_ms = 0 if offset is None else round(1e3 * (now_ns / 1e9 - offset))
        if self._size != self._sent_size:
            # Whoever asked before the first image was told that it is not known.
            self._sent_size = self._size
            send(self._camera.information(self._size, boot_ms))
        while self._commands:
            command = self._commands.popleft()
            for message in self._camera.answers(command, state.identity, self._size, boot_ms):
                send(message)
        for image, found in settled(self._images, link, timeout):
            tag = None if isinstance(found, PoseError) else found
            send(self._camera.captured(image.stamp, tag, self._mount, state.origin))
            self._diagnostics.count('images told')
        while self._failures:
            self._failures -= 1
            send(self._camera.captured(now_ns, None, self._mount, None, is_good=False))

    def _on_camera_info(self, message: CameraInfo) -> None:
        self._size = (message.width, message.height)
        self._images.append(Waiting.of(message))

    def _shoot(self) -> bool:
        if not self._client.service_is_ready():
            self._diagnostics.refuse(
                'no camera', 'a photograph was commanded, but camera_capture does not run'
            )
            return False
        self._diagnostics.count('photographs commanded')
        self._client.call_async(Trigger.Request()).add_done_callback(self._on_shot)
        return True

    def _on_shot(self, future: Future) -> None:
        response = future.result()
        if response is None or not response.success:
            self._failures += 1
            reason = response.message if response else 'no answer'
            self._diagnostics.refuse('no photograph', f'camera_capture: {reason}')


class BridgeTags:
    """Publishes ``tagged/points``, ``tagged/preview``, ``tagged/camera_pose``, ``tagged/pose``.

    All or none, but for clouds that nobody subscribes to.

    Parameters
    ----------
    node : MavlinkBridge
    mount : Pose
        Of the camera's optical frame on the vehicle.
    """

    def __init__(
        self,
        node: MavlinkBridge,
        mount: Pose,
    ) -> None:
        given = node.given
        self._frame, self._mount = given.map_frame, mount
        self._mount_covariance = pose_covariance.diagonal(
            3 * (given.translation_uncertainty,), 3 * (given.rotation_uncertainty,)
        )
        self._diagnostics, self._preview_columns = node.diagnostics, given.preview_columns
        most_at_once = given.queue_size
        # Clouds that waited for one report are published in one breath: a shorter history would
        # throw those away that nobody has fetched yet.
        history = QoSProfile(depth=max(10, most_at_once), reliability=ReliabilityPolicy.RELIABLE)
        self._points = node.create_publisher(
            PointCloud2, 'tagged/points', history, qos_overriding_options=OVERRIDABLE
        )
        self._preview = node.create_publisher(
            PointCloud2, 'tagged/preview', PREVIEWS, qos_overriding_options=OVERRIDABLE
        )
        depth = history if most_at_once > POSES.depth else POSES
        self._pose = node.create_publisher(PoseWithCovarianceStamped, 'tagged/pose', depth)
        self._camera_pose = node.create_publisher(
            PoseWithCovarianceStamped, 'tagged/camera_pose', depth
        )

    def publish(self, message: PointCloud2, stamp: int, tag: Tag) -> None:
        """Publish a cloud (in the camera's frame) with its pose.

        Raises
        ------
        CloudError
            It is malformed; nothing is published then.
        """
        camera = tag.pose @ self._mount
        covariance = pose_covariance.of_mounted(
            tag.covariance, tag.pose, self._mount, self._mount_covariance
        )
        # Read whether somebody takes it or not: of what is no cloud there is no pose either.
        cloud = cloud_from_message(message)
        self._publish_cloud(self._points, cloud, camera, stamp)
        if self._preview.get_subscription_count():
            few, _ = thinned(cloud, None, self._preview_columns)
            self._publish_cloud(self._preview, few, camera, stamp)
        frame = self._frame
        self._camera_pose.publish(covariant_pose_message(camera, covariance, stamp, frame))
        self._pose.publish(covariant_pose_message(tag.pose, tag.covariance, stamp, frame))
        self._diagnostics.count('tagged')
        deviations = np.sqrt(np.diag(covariance))
        self._diagnostics.notes(
            {
                'camera within, across (mm)': f'{1e3 * deviations[:2].max():.0f}',
                'camera within, up (mm)': f'{1e3 * deviations[2]:.0f}',
                'camera within (deg)': f'{np.degrees(deviations[3:].max()):.2f}',
            }
        )

    def _publish_cloud(self, publisher: Publisher, cloud: Cloud, camera: Pose, stamp: int) -> None:
        if publisher.get_subscription_count():
            in_map = cloud.transformed(camera)
            publisher.publish(cloud_to_message(in_map, stamp, self._frame))


class MavlinkBridge(PayloadNode[MavlinkBridgeSettings]):
    """Node that tags clouds with the autopilot's pose."""

    def __init__(self, **options: Any) -> None:
        super().__init__('mavlink_bridge', **options)
        given = self.given
        self._earth = None
        if given.earth:
            self._earth = self.create_publisher(NavSatFix, 'earth', LATCHED)
        self._origin: Origin | None = None
        mount = Pose.from_rpy(given.rpy, given.translation)
        self.diagnostics.hardware_id = given.address
        self._waiting: deque[Waiting] = deque()
        self._said: tuple[str, str] | None = None
        self._poses = self.create_publisher(PoseStamped, 'mavlink/pose', POSES)
        self._transforms = TransformPublisher(self) if given.publish_tf else None
        if self._transforms is not None:
            frames = given.base_frame, given.camera_frame
            self._transforms.publish(mount, *frames, self.now_ns(), static=True)
        self._tags = BridgeTags(self, mount)
        self.create_subscription(
            PointCloud2, 'points', self._on_points, CLOUDS, qos_overriding_options=OVERRIDABLE
        )
        self._news = self.create_guard_condition(self._settle)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.1, self._settle, clock=steady)
        self.create_timer(1.0, self._send_heartbeat, clock=steady)
        self._mavlink_camera = BridgeCamera(self, mount) if given.is_camera else None
        # Last, for its thread must not be left behind if something above fails.
        self._link = Link(
            given.address,
            given.baud,
            given.vehicle(),
            self.now_ns,
            self._on_link_poses,
            given.signing_key or b'',
            self._on_link_command,
        )

    def destroy_node(self) -> None:
        """Close the link first."""
        self._link.close()
        super().destroy_node()

    def _send_heartbeat(self) -> None:
        self._link.send_heartbeat()
        if self._mavlink_camera is not None:
            self._mavlink_camera.send_heartbeat(self._link)

    def _on_link_poses(self, poses: list[tuple[int, Pose]]) -> None:
        """Publish, in the link's thread: fifty wake-ups a second of an executor are dear."""
        for stamp, pose in poses:
            self.diagnostics.count('poses')
            self._poses.publish(pose_stamped_message(pose, stamp, self.given.map_frame))
            if self._transforms is not None:
                self._transforms.publish(pose, self.given.map_frame, self.given.base_frame, stamp)
        if self._waiting:
            self._news.trigger()

    def _on_link_command(self, command: Any) -> None:
        if self._mavlink_camera is not None:
            self._mavlink_camera.take(command)
            self._news.trigger()

    def _on_points(self, message: PointCloud2) -> None:
        self.diagnostics.count('clouds')
        frame = message.header.frame_id
        if frame != self.given.camera_frame:
            self.diagnostics.refuse(
                'wrong frame',
                f'the cloud is in the frame {frame!r}, but the mount is that of '
                f'{self.given.camera_frame!r}: set camera_frame',
            )
            return
        self._waiting.append(Waiting.of(message))
        self._settle()
        while len(self._waiting) > self.given.queue_size:
            # There is no room for it any more: it is refused for what it has waited for.
            self._tag_settled(deque([self._waiting.popleft()]), 0.0)

    def _settle(self) -> None:
        """Tag or refuse each waiting cloud for which that can be said by now."""
        timeout = self.settings['pose_timeout']
        if self._mavlink_camera is not None:
            self._mavlink_camera.settle(self._link, self.now_ns(), timeout)
        self._tag_settled(self._waiting, timeout)

    def _tag_settled(self, waiting: deque[Waiting], timeout: float) -> None:
        for cloud, found in settled(waiting, self._link, timeout):
            if isinstance(found, PoseError):
                age, waited = self.now_ns() - cloud.stamp, time.monotonic() - cloud.arrival
                self.diagnostics.refuse(
                    found.reason,
                    f'no pose for the cloud of {cloud.stamp / 1e9:.3f} ({age / 1e9:.1f} s ago) '
                    f'after {waited:.1f} s: {found}',
                )
                continue
            with self.diagnostics.guarded('a cloud could not be tagged'):
                self._tags.publish(cloud.message, cloud.stamp, found)
                self.diagnostics.measure('waited', time.monotonic() - cloud.arrival)

    def _judge(self) -> tuple[bytes, str]:
        state = self._link.state()
        self.diagnostics.notes(state.figures)
        self.diagnostics.note('clouds waiting', len(self._waiting))
        self._follow_origin(state.origin)
        verdict = state.verdict
        said = (verdict.severity, verdict.reason or verdict.text)
        if said != self._said:
            self._said = said
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
            self.diagnostics.refuse(
                'moved map',
                f"the map's origin has moved by {origin.distance(self._origin):.2f} m: clouds of "
                'before and after do not lie together, take the list of dents and begin anew',
            )
        self._origin = origin
        if self._earth is not None:
            self._earth.publish(fix_message(origin, self.now_ns(), self.given.map_frame))


def fix_message(origin: Origin, stamp_ns: int, frame_id: str) -> NavSatFix:
    """sensor_msgs/NavSatFix of the origin of the frame `frame_id`."""
    return NavSatFix(
        header=make_header(stamp_ns, frame_id),
        status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=NavSatStatus.SERVICE_GPS),
        latitude=origin.latitude,
        longitude=origin.longitude,
        altitude=origin.altitude,
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_UNKNOWN,
    )


#: Run the node as a process.
main = partial(run, MavlinkBridge, 'mavlink_bridge')


if __name__ == '__main__':
    sys.exit(main())
