"""The payload's topics to the ground, as a thin and unreliable link allows.

What is most important goes first: state, dents, poses, previews, then whole clouds and pictures.
What cannot be sent now is kept and sent when the link is better. Commands of the ground are done
once each. The payload never waits for any of this.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import RayGrid, encode, thinned
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.commands import Answer, Executive, Recordings
from ftp_dent_ros.ground.drone import Drone
from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.protocol import Item, remember
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import DownlinkSettings
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.diagnostics import OK, WARN, Verdict
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    image_from_message,
    lens_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, DIAGNOSTICS, IMAGES, LATCHED, POSES


def _jpeg(bgr: Any, quality: int) -> bytes:
    return cv2.imencode('.jpg', bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


class Downlink(PayloadNode[DownlinkSettings]):
    """Node that sends what the payload publishes to the ground."""

    def _set_up(self) -> None:
        given = self.given
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._lens: Lens | None = None
        self._recordings = Recordings(Path(given.recordings).expanduser(), self.get_logger().info)
        self.ending.callback(self._recordings.close)

        def call(service: str) -> Callable[[], Answer]:
            return partial(self._call, self.create_client(Trigger, service))

        does = {
            'capture': call('camera_capture/capture'),
            'take_list': call('dent_inspector/take_list'),
            'start_recording': self._recordings.start,
            'stop_recording': self._recordings.stop,
        }
        self.diagnostics.hardware_id = given.address
        self._drone = Drone(
            GroundLink('drone', given.address, given.security, given.name),
            Path(given.spool).expanduser() if given.spool else None,
            given.room * 10**6,
            given.limit * 125,  # byte/s
            Executive(does),
        )
        self.ending.callback(self._drone.close)
        if not given.keys:
            self.get_logger().warning(f'{given.address}: no keys: whoever reaches it may command')
        # Some seconds of a busy machine.
        coding = self.worker(self._send_coded, 'a message could not be coded', finish=True, room=8)
        for topic in topics.TOPICS.values():
            if not topic.coded and topic.name != topics.DIAGNOSTICS:
                forward, qos = partial(self._forward, topic), LATCHED if topic.latest else POSES
                self.hear(message_class(topic.type), topic.name, forward, qos, raw=True)
        self.hear(DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, DIAGNOSTICS)
        self.hear(CameraInfo, topics.CAMERA_INFO, self._learn, IMAGES, 'wrong camera_info')
        self.hear(PointCloud2, topics.POINTS, coding.put, CLOUDS)
        if given.pictures:
            self.hear(Image, topics.IMAGE, coding.put, CLOUDS)

    def _forward(self, topic: topics.Topic, data: bytes) -> None:
        """Send a serialised message as it is."""
        stamp = self.now_ns()
        if topic.stamped:
            # It begins with a header: CDR, after its four bytes.
            seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
            stamp = seconds * 1_000_000_000 + nanoseconds
        self._send(topic.item(stamp, data))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            remember(self._statuses, status.name, status, 100)
        if self._drone.is_due(topics.DIAGNOSTICS):
            array = DiagnosticArray(status=list(self._statuses.values()))
            array.header.stamp = self.get_clock().now().to_msg()
            topic = topics.TOPICS[topics.DIAGNOSTICS]
            self._send(topic.item(self.now_ns(), serialize_message(array)))

    def _learn(self, message: CameraInfo) -> None:
        """The lens that clouds and pictures are of."""
        self._lens = lens_from_message(message)

    def _send_coded(self, message: Any) -> None:
        """Code and send a cloud or a picture, in the worker's thread."""
        send = self._send_cloud if isinstance(message, PointCloud2) else self._send_picture
        send(message)

    def _send_cloud(self, message: PointCloud2) -> None:
        """A cloud, and a small one before it if it is time for one."""
        cloud = cloud_from_message(message)
        stamp, frame = stamp_to_ns(message.header.stamp), message.header.frame_id
        rows, columns = cloud.intensity.shape
        view = RayGrid.of(self._lens, rows, columns) if self._lens is not None else None
        if self._drone.is_due(topics.PREVIEW_POINTS):
            few, few_view = thinned(cloud, view, self.given.preview_columns)
            data = encode(Cloud(few.points, few.intensity), few_view, 4.0)  # 1.3 um at 0.8 m
            self._send(topics.TOPICS[topics.PREVIEW_POINTS].item(stamp, data, frame))
        started = time.thread_time()
        data = encode(cloud, view)
        self.diagnostics.count('coding', time.thread_time() - started)
        self.diagnostics.count('clouds')
        self.diagnostics.note({'bytes of a cloud': len(data)})
        self._send(topics.TOPICS[topics.POINTS].item(stamp, data, frame))

    def _send_picture(self, message: Image) -> None:
        """A picture, and a small one before it if it is time for one."""
        bgr = cv2.cvtColor(image_from_message(message), cv2.COLOR_RGB2BGR)
        stamp, frame = stamp_to_ns(message.header.stamp), message.header.frame_id
        if self._drone.is_due(topics.PREVIEW_IMAGE):
            height = round(bgr.shape[0] * 240 / bgr.shape[1])
            small = _jpeg(cv2.resize(bgr, (240, height), interpolation=cv2.INTER_AREA), 50)
            self._send(topics.TOPICS[topics.PREVIEW_IMAGE].item(stamp, small, frame))
        data = _jpeg(bgr, self.given.jpeg_quality)
        self.diagnostics.count('pictures')
        self.diagnostics.note({'bytes of a picture': len(data)})
        self._send(topics.TOPICS[topics.IMAGE].item(stamp, data, frame, self._lens))

    def _send(self, item: Item) -> None:
        self.diagnostics.count('items')
        self._drone.put(item)

    def _call(self, client: Any) -> Answer:
        """Call a service of the payload, in a thread that is not the executor's."""
        if not client.wait_for_service(1.0):
            return Answer(False, f'{client.srv_name} is not there: its node does not run')
        response = client.call(Trigger.Request(), 15.0)
        if response is None:
            return Answer(False, f'{client.srv_name} has not answered within 15 s')
        return Answer(bool(response.success), str(response.message))

    def _judge(self) -> Sequence[Verdict]:
        state, trouble = self._drone.state(), self._drone.trouble()
        self.diagnostics.note({**state, 'recording': self._recordings.state})
        unheard = f'no ground is heard: {state["waiting (MB)"]} MB are kept'
        return (
            (trouble, WARN, trouble),
            (state['grounds'] == '0', WARN, unheard),
            (True, OK, f'{state["rate (kbit/s)"]} kbit/s'),
        )
