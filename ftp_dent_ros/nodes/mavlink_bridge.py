"""The autopilot's pose for every cloud, and the payload as a MAVLink camera.

Keeps a MAVLink link, publishes the autopilot's poses on ``mavlink/pose``, and for each cloud on
``points`` the same cloud in the map frame on ``tagged/points``, its every n-th point on
``tagged/preview`` for those in the network, and the poses at exactly its stamp, of the vehicle on
``tagged/pose``, of the camera on ``tagged/camera_pose``. A cloud waits, without holding anything
up, until all that its pose depends on has been heard; a pose that cannot be had is counted and
logged with its reason, and nothing is published in its place.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Transform,
    TransformStamped,
    Vector3,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo, NavSatFix, NavSatStatus, PointCloud2
from std_srvs.srv import Trigger

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
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Verdict
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    cloud_to_message,
    covariant_pose_message,
    make_header,
    pose_stamped_message,
    pose_to_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, LATCHED, OVERRIDABLE, POSES, PREVIEWS, quality

_LEVELS = {'ok': OK, 'warning': WARN, 'error': ERROR}


try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None


class Waiting:
    """A cloud or the telling of an image that waits for its pose from now on."""

    def __init__(self, message: Any) -> None:
        self.message, self.stamp = message, stamp_to_ns(message.header.stamp)
        self._arrival = time.monotonic()

    @property
    def waited(self) -> float:
        """Seconds since it came."""
        return time.monotonic() - self._arrival


def settled(
    waiting: deque[Waiting], link: Link, timeout: float
) -> Iterator[tuple[Waiting, Tag | PoseError]]:
    """Take out what has its pose by now, or why there will be none, at the latest after a time."""
    for _ in range(len(waiting)):
        each = waiting.popleft()
        try:
            found: Tag | PoseError = link.tag_at(each.stamp)
        except PoseError as error:
            if each.waited < timeout and isinstance(error, PoseAwaitedError):
                waiting.append(each)
                continue
            found = error
        yield each, found


class BridgeCamera:
    """Commands from the link become calls of ``camera_capture/capture``, images become messages.

    All but `take` runs in the executor, so that a node that is stuck answers nothing.
    """

    def __init__(self, node: MavlinkBridge, mount: Pose) -> None:
        self._node, self._mount = node, mount
        self._camera = Camera(node.given.ground_station, self._shoot)
        rig = node.given.rig
        self._size = self._sent_size = (rig.camera.width, rig.camera.height) if rig else (0, 0)
        self._commands: deque[Any] = deque(maxlen=20)
        self._images: deque[Waiting] = deque(maxlen=20)
        self._client = node.create_client(Trigger, 'camera_capture/capture')
        node.hear(CameraInfo, 'camera/camera_info', self._on_camera_info, IMAGES)

    def take(self, command: Any) -> None:
        """Keep a command for `settle`; from any thread."""
        self._commands.append(command)
        self._node.news.trigger()

    def settle(self) -> None:
        """Answer what can be answered by now."""
        has_news = self._commands or self._images or self._size != self._sent_size
        state = self._node.link.state() if has_news else None
        if state is None or state.identity is None:
            return
        offset, now_ns = state.clock_offset, self._node.now_ns()
        boot_ms = 0 if offset is None else round(1e3 * (now_ns / 1e9 - offset))
        if self._size != self._sent_size:
            # Whoever asked before the first image was answered that it is not known.
            self._sent_size = self._size
            self._send(self._camera.information(self._size, boot_ms))
        while self._commands:
            command = self._commands.popleft()
            for message in self._camera.answers(command, state.identity, self._size, boot_ms):
                self._send(message)
        timeout = self._node.settings['pose_timeout']
        for image, found in settled(self._images, self._node.link, timeout):
            tag = None if isinstance(found, PoseError) else found
            self._send(self._camera.captured(image.stamp, tag, self._mount, state.origin))
            self._node.diagnostics.count('images reported')

    def _send(self, message: Any) -> None:
        self._node.link.send(message, COMPONENT)

    def _on_camera_info(self, message: CameraInfo) -> None:
        self._size = (message.width, message.height)
        self._images.append(Waiting(message))

    def _shoot(self) -> bool:
        if not self._client.service_is_ready():
            self._node.diagnostics.refuse(
                'no camera', 'a photograph was commanded, but camera_capture does not run'
            )
            return False
        self._node.diagnostics.count('photographs commanded')
        self._client.call_async(Trigger.Request()).add_done_callback(self._on_shot)
        return True

    def _on_shot(self, future: Future) -> None:
        response = future.result()
        if response is None or not response.success:
            now_ns = self._node.now_ns()
            self._send(self._camera.captured(now_ns, None, self._mount, None, is_good=False))
            reason = response.message if response else 'no answer'
            self._node.diagnostics.refuse('no photograph', f'camera_capture: {reason}')


class MavlinkBridge(PayloadNode[MavlinkBridgeSettings]):
    """Node that tags clouds with the autopilot's pose."""

    def _set_up(self) -> None:
        given = self.given
        self._origin: Origin | None = None
        self._mount = Pose.from_rpy(given.rpy, given.translation)
        self._mount_covariance = pose_covariance.diagonal(
            3 * (given.translation_uncertainty,), 3 * (given.rotation_uncertainty,)
        )
        self.diagnostics.hardware_id = given.address
        self._waiting: deque[Waiting] = deque()
        self._said: tuple[str, str] | None = None
        # Clouds that waited for one report are published in one breath: a shorter history would
        # throw those away that nobody has fetched yet.
        history = quality(True, False, max(POSES.depth, given.queue_size))
        self._points = self.create_publisher(
            PointCloud2, 'tagged/points', history, qos_overriding_options=OVERRIDABLE
        )
        self._preview = self.create_publisher(
            PointCloud2, 'tagged/preview', PREVIEWS, qos_overriding_options=OVERRIDABLE
        )
        self._pose = self.create_publisher(PoseWithCovarianceStamped, 'tagged/pose', history)
        self._camera_pose = self.create_publisher(
            PoseWithCovarianceStamped, 'tagged/camera_pose', history
        )
        self._earth = self.create_publisher(NavSatFix, 'earth', LATCHED) if given.earth else None
        self._poses = self.create_publisher(PoseStamped, 'mavlink/pose', POSES)
        #: Of /tf and /tf_static; none where TF is not wanted or not installed.
        self._transforms: list[Publisher] = []
        if given.publish_tf and TFMessage is not None:
            # As tf2_ros has them.
            self._transforms = [
                self.create_publisher(TFMessage, '/tf', 100),
                self.create_publisher(TFMessage, '/tf_static', LATCHED),
            ]
        frames = given.base_frame, given.camera_frame
        self._transform(self._mount, *frames, self.now_ns(), is_static=True)
        self.hear(PointCloud2, 'points', self._on_points, CLOUDS)
        #: Triggered when something that waits may be settled.
        self.news = self.create_guard_condition(self._settle)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.1, self._settle, clock=steady)
        self.create_timer(1.0, self._send_heartbeats, clock=steady)
        self._camera = BridgeCamera(self, self._mount) if given.is_camera else None
        self.link = Link(
            given.address,
            given.baud,
            given,
            self.now_ns,
            self._on_link_poses,
            given.signing_key or b'',
            self._camera.take if self._camera else lambda command: None,
        )
        self.ending.callback(self.link.close)

    def _on_link_poses(self, poses: list[tuple[int, Pose]]) -> None:
        """Publish, in the link's thread: fifty wake-ups a second of an executor are dear."""
        for stamp, pose in poses:
            self.diagnostics.count('poses')
            self._poses.publish(pose_stamped_message(pose, stamp, self.given.map_frame))
            self._transform(pose, self.given.map_frame, self.given.base_frame, stamp)
        if self._waiting:
            self.news.trigger()

    def _send_heartbeats(self) -> None:
        self.link.send_heartbeat()
        if self._camera:
            self.link.send_heartbeat(mavlink.MAV_TYPE_CAMERA, COMPONENT)

    def _transform(
        self, pose: Pose, parent: str, child: str, stamp_ns: int, is_static: bool = False
    ) -> None:
        """Publish the pose of a child frame in its parent."""
        if self._transforms:
            message = pose_to_message(pose)
            at = message.position
            transform = TransformStamped(
                header=make_header(stamp_ns, parent),
                child_frame_id=child,
                transform=Transform(
                    translation=Vector3(x=at.x, y=at.y, z=at.z), rotation=message.orientation
                ),
            )
            self._transforms[is_static].publish(TFMessage(transforms=[transform]))

    def _on_points(self, message: PointCloud2) -> None:
        self.diagnostics.count('clouds')
        frame = message.header.frame_id
        if frame != self.given.camera_frame:
            raise PoseError(
                f'the cloud is in the frame {frame!r}, but the mount is that of '
                f'{self.given.camera_frame!r}: set camera_frame',
                'wrong frame',
            )
        self._waiting.append(Waiting(message))
        self._settle()
        while len(self._waiting) > self.given.queue_size:
            # There is no room for it any more: it is refused for what it has waited for.
            self._tag(deque([self._waiting.popleft()]), 0.0)

    def _settle(self) -> None:
        self._tag(self._waiting, self.settings['pose_timeout'])
        if self._camera:
            self._camera.settle()

    def _tag(self, waiting: deque[Waiting], timeout: float) -> None:
        """Tag or refuse each waiting cloud for which that can be said by now."""
        for cloud, found in settled(waiting, self.link, timeout):
            with self.diagnostics.guarded('a cloud could not be tagged'):
                if isinstance(found, PoseError):
                    age = self.now_ns() - cloud.stamp
                    raise PoseError(
                        f'no pose for the cloud of {cloud.stamp / 1e9:.3f} ({age / 1e9:.1f} s '
                        f'ago) after {cloud.waited:.1f} s: {found}',
                        found.reason,
                    )
                self._publish(cloud, found)

    def _publish(self, waiting: Waiting, tag: Tag) -> None:
        """Publish a cloud and its poses: all or none, but for clouds that nobody subscribes to."""
        stamp, frame = waiting.stamp, self.given.map_frame
        camera = tag.pose @ self._mount
        covariance = pose_covariance.of_mounted(
            tag.covariance, tag.pose, self._mount, self._mount_covariance
        )
        # Read whether somebody takes it or not: of what is no cloud there is no pose either.
        cloud = cloud_from_message(waiting.message)
        if self._points.get_subscription_count():
            self._points.publish(cloud_to_message(cloud.transformed(camera), stamp, frame))
        if self._preview.get_subscription_count():
            few, _ = thinned(cloud, None, self.given.preview_columns)
            self._preview.publish(cloud_to_message(few.transformed(camera), stamp, frame))
        self._camera_pose.publish(covariant_pose_message(camera, covariance, stamp, frame))
        self._pose.publish(covariant_pose_message(tag.pose, tag.covariance, stamp, frame))
        self.diagnostics.count('tagged')
        self.diagnostics.count('waited', waiting.waited)
        deviations = np.sqrt(np.diag(covariance))
        self.diagnostics.note(
            {
                'camera within, across (mm)': f'{1e3 * deviations[:2].max():.0f}',
                'camera within, up (mm)': f'{1e3 * deviations[2]:.0f}',
                'camera within (deg)': f'{np.degrees(deviations[3:].max()):.2f}',
            }
        )

    def _judge(self) -> tuple[Verdict, ...]:
        state = self.link.state()
        self.diagnostics.note({**state.figures, 'clouds waiting': len(self._waiting)})
        self._follow_origin(state.origin)
        verdict, log = state.verdict, self.get_logger()
        said = (verdict.severity, verdict.reason or verdict.text)
        if said != self._said:
            self._said = said
            # One line a severity: rclpy ties a severity to the line that logs.
            if verdict.severity == 'ok':
                log.info(verdict.text)
            elif verdict.severity == 'warning':
                log.warning(verdict.text)
            else:
                log.error(verdict.text)
        return ((True, _LEVELS[verdict.severity], verdict.text),)

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
            self._earth.publish(
                NavSatFix(
                    header=make_header(self.now_ns(), self.given.map_frame),
                    status=NavSatStatus(
                        status=NavSatStatus.STATUS_FIX, service=NavSatStatus.SERVICE_GPS
                    ),
                    latitude=origin.latitude,
                    longitude=origin.longitude,
                    altitude=origin.altitude,
                    position_covariance_type=NavSatFix.COVARIANCE_TYPE_UNKNOWN,
                )
            )
