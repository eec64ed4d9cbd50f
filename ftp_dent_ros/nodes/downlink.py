"""The payload's topics to the ground, as a thin and unreliable link allows.

What is most important goes first: state, dents, poses, previews, then whole clouds and pictures.
What cannot be sent now is kept and sent when the link is better. Commands of the ground are done
once each. The payload never waits for any of this.
"""

from __future__ import annotations

import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import RayGrid, encode, thinned
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.commands import Answer, Executive, Recordings
from ftp_dent_ros.ground.drone import Drone
from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.protocol import LARGEST_REFERENCE, Item, deflate
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
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.qos import CLOUDS, DIAGNOSTICS, IMAGES, LATCHED, POSES


class Thrift:
    """Items of topics that have a share of the link, each in the place of the one before.

    Parameters
    ----------
    put : callable
        Takes each item.
    rate : callable
        byte/s that the link carries; 0 if that is not known.
    """

    def __init__(self, put: Callable[[Item], None], rate: Callable[[], float]) -> None:
        self._put, self._rate = put, rate
        self._lock = threading.Lock()
        self._waiting: dict[str, Item] = {}
        # Of each topic: when its last was sent, how much crosses the air of it, and what it was.
        self._sent: dict[str, tuple[float, int, bytes]] = {}

    def is_due(self, name: str) -> bool:
        """Whether the next of a topic may be sent, by the rate as it is known now."""
        at, size, _ = self._sent.get(name, (float('-inf'), 0, b''))
        # In the beginning it is known to be far too low.
        rate, topic = self._rate(), topics.TOPICS[name]
        pause = size / (topic.share * rate) if rate else 0.0
        return time.monotonic() >= at + max(topic.period, pause)

    def put(self, item: Item) -> None:
        """Send an item, or keep it until its topic's next is due."""
        self._waiting[item.topic] = item
        self.flush()

    def flush(self) -> None:
        """Send what is due; from any thread."""
        with self._lock:
            for name in filter(self.is_due, list(self._waiting)):
                item = self._waiting.pop(name)
                *_, last = self._sent.get(name, (b'',))
                reference = last if len(last) <= LARGEST_REFERENCE else b''
                size = len(deflate(item.data, 1, reference))
                self._sent[name] = time.monotonic(), size, item.data
                self._put(item)


def _jpeg(bgr: Any, quality: int) -> bytes:
    done, data = cv2.imencode('.jpg', bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ImageError('a picture could not be compressed: look at its size')
    return data.tobytes()


class Downlink(PayloadNode[DownlinkSettings]):
    """Node that sends what the payload publishes to the ground."""

    def __init__(self, **options: Any) -> None:
        super().__init__('downlink', **options)
        given = self.given
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._lens: Lens | None = None
        self._recordings = Recordings(Path(given.recordings).expanduser(), self.get_logger().info)
        self.ending.callback(self._recordings.close)
        does = {
            'start_recording': self._recordings.start,
            'stop_recording': self._recordings.stop,
        }
        for service in ('camera_capture/capture', 'dent_inspector/take_list'):
            client = self.create_client(Trigger, service)
            does[service.rpartition('/')[2]] = partial(self._call, client)
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
        self._worker = self.worker(
            lambda code: code(), 'a message could not be coded', finish=True, room=8
        )
        self._thrift = Thrift(self._send, self._drone.rate)
        self.create_timer(1.0, self._thrift.flush, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for topic in topics.TOPICS.values():
            if not topic.coded and topic.name != topics.DIAGNOSTICS:
                forward, qos = partial(self._forward, topic), LATCHED if topic.latest else POSES
                self.hear(message_class(topic.type), topic.name, forward, qos, raw=True)
        self.hear(DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, DIAGNOSTICS)
        self.hear(
            CameraInfo,
            topics.CAMERA_INFO,
            self._learn,
            IMAGES,
            'camera_info could not be read',
            'wrong camera_info',
        )
        coded: list[tuple[Any, str, Callable[[Any], None]]] = [
            (PointCloud2, topics.POINTS, self._send_cloud)
        ]
        if given.pictures:
            coded.append((Image, topics.IMAGE, self._send_picture))
        for kind, name, send in coded:
            self.hear(kind, name, partial(self._put_off, send), CLOUDS)

    def _forward(self, topic: topics.Topic, data: bytes) -> None:
        """Send a serialised message as it is."""
        stamp = self.now_ns()
        if topic.stamped:
            # It begins with a header: CDR, after its four bytes.
            seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
            stamp = seconds * 1_000_000_000 + nanoseconds
        send = self._thrift.put if topic.share else self._send
        send(topic.item(stamp, data))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if len(self._statuses) < 100:
                self._statuses[status.name] = status
        if self._thrift.is_due(topics.DIAGNOSTICS):
            array = DiagnosticArray(status=list(self._statuses.values()))
            array.header.stamp = self.get_clock().now().to_msg()
            topic = topics.TOPICS[topics.DIAGNOSTICS]
            self._thrift.put(topic.item(self.now_ns(), serialize_message(array)))

    def _learn(self, message: CameraInfo) -> None:
        """The lens that clouds and pictures are of."""
        self._lens = lens_from_message(message)

    def _put_off(self, send: Callable[[Any], None], message: Any) -> None:
        """Have a cloud or picture coded and sent in the worker's thread."""
        self._worker.put(partial(send, message))

    def _send_cloud(self, message: PointCloud2) -> None:
        """A cloud, and a small one before it if it is time for one."""
        cloud = cloud_from_message(message)
        stamp, frame = stamp_to_ns(message.header.stamp), message.header.frame_id
        rows, columns = cloud.intensity.shape
        view = RayGrid.of(self._lens, rows, columns) if self._lens is not None else None
        if self._thrift.is_due(topics.PREVIEW_POINTS):
            few, few_view = thinned(cloud, view, self.given.preview_columns)
            data = encode(Cloud(few.points, few.intensity), few_view, 4.0)  # 1.3 um at 0.8 m
            self._thrift.put(topics.TOPICS[topics.PREVIEW_POINTS].item(stamp, data, frame=frame))
        started = time.thread_time()
        data = encode(cloud, view)
        self.diagnostics.measure('coding', time.thread_time() - started)
        self.diagnostics.count('clouds')
        self.diagnostics.note({'bytes of a cloud': len(data)})
        self._send(topics.TOPICS[topics.POINTS].item(stamp, data, frame=frame))

    def _send_picture(self, message: Image) -> None:
        """A picture, and a small one before it if it is time for one."""
        bgr = cv2.cvtColor(image_from_message(message), cv2.COLOR_RGB2BGR)
        stamp, frame = stamp_to_ns(message.header.stamp), message.header.frame_id
        if self._thrift.is_due(topics.PREVIEW_IMAGE):
            height = round(bgr.shape[0] * 240 / bgr.shape[1])
            small = _jpeg(cv2.resize(bgr, (240, height), interpolation=cv2.INTER_AREA), 50)
            self._thrift.put(topics.TOPICS[topics.PREVIEW_IMAGE].item(stamp, small, frame=frame))
        data = _jpeg(bgr, self.given.jpeg_quality)
        self.diagnostics.count('pictures')
        self.diagnostics.note({'bytes of a picture': len(data)})
        lens = {} if self._lens is None else {'lens': RayGrid(self._lens, 1).numbers()}
        self._send(topics.TOPICS[topics.IMAGE].item(stamp, data, frame=frame, **lens))

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


#: Run the node as a process.
main = partial(run, Downlink, 'downlink')


if __name__ == '__main__':
    sys.exit(main())
