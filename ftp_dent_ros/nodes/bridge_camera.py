"""The camera of the payload as a MAVLink camera: photographs for the ground station."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo
from std_srvs.srv import Trigger

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.camera import COMPONENT, Camera
from ftp_dent_ros.navigation.link import Link
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import Diagnostics
from ftp_dent_ros.ros.messages import stamp_to_ns
from ftp_dent_ros.ros.qos import IMAGES, OVERRIDABLE

# Commands, and images, that wait for each other.
_MOST_WAITING = 20


class BridgeCamera:
    """Commands from the link become calls of ``camera_capture/capture``, images become messages.

    All but `take` runs in the executor, so that a node that is stuck answers nothing.
    """

    def __init__(
        self,
        node: Node,
        ground_station: int,
        mount: Pose,
        size: tuple[int, int],
        diagnostics: Diagnostics,
    ) -> None:
        self._node, self._mount, self._diagnostics = node, mount, diagnostics
        self._camera = Camera(ground_station, self._shoot)
        self._size = self._told_size = size
        self._commands: deque[Any] = deque(maxlen=_MOST_WAITING)
        self._images: deque[tuple[int, float]] = deque(maxlen=_MOST_WAITING)
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
        has_news = self._commands or self._images or self._size != self._told_size
        state = link.state() if has_news else None
        if state is None or state.identity is None:
            return
        offset = state.clock_offset
        boot_ms = 0 if offset is None else round(1e3 * (now_ns / 1e9 - offset))
        if self._size != self._told_size:
            # Whoever asked before the first image was told that it is not known.
            self._told_size = self._size
            send(self._camera.information(self._size, boot_ms))
        while self._commands:
            command = self._commands.popleft()
            for message in self._camera.answers(command, state.identity, self._size, boot_ms):
                send(message)
        for _ in range(len(self._images)):
            stamp, arrival = self._images.popleft()
            try:
                tag = link.tag_at(stamp)
            except PoseAwaitedError:
                if time.monotonic() - arrival < timeout:
                    self._images.append((stamp, arrival))
                    continue
                tag = None
            except PoseError:
                tag = None
            send(self._camera.captured(stamp, tag, self._mount, state.origin))
            self._diagnostics.count('images told')
        while self._failures:
            self._failures -= 1
            send(self._camera.captured(now_ns, None, self._mount, None, is_good=False))

    def _on_camera_info(self, message: CameraInfo) -> None:
        self._size = (message.width, message.height)
        self._images.append((stamp_to_ns(message.header.stamp), time.monotonic()))

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
