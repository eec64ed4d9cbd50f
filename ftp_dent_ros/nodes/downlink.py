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
from collections.abc import Callable
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
from ftp_dent_ros.ground.protocol import Importance, Item, deflate
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import DownlinkSettings
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.diagnostics import OK, WARN, Diagnostics
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    image_from_message,
    lens_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.node import NewestWorker, run
from ftp_dent_ros.ros.qos import CLOUDS, DIAGNOSTICS, IMAGES, LATCHED, OVERRIDABLE, POSES


class Coder:
    """Codes what the downlink's worker hands to it.

    Parameters
    ----------
    given : DownlinkSettings
    put : callable
        Takes each item.
    rate : callable
        byte/s that the link carries; 0 if that is not known.
    diagnostics : Diagnostics
    """

    def __init__(
        self,
        given: DownlinkSettings,
        put: Callable[[Item], None],
        rate: Callable[[], float],
        diagnostics: Diagnostics,
    ) -> None:
        self._given, self._put, self._diagnostics = given, put, diagnostics
        self._lens: Lens | None = None
        # Two a second at most.
        self._previews, self._picture_previews = Share(rate, 0.4, 0.45), Share(rate, 0.4, 0.45)

    def learn(self, message: CameraInfo) -> None:
        """The lens that clouds and pictures are of."""
        with self._diagnostics.guarded('camera_info could not be read', 'wrong camera_info'):
            self._lens = lens_from_message(message)

    def send_cloud(self, message: PointCloud2) -> None:
        """A cloud, and a small one before it if it is time for one."""
        cloud = cloud_from_message(message)
        stamp = stamp_to_ns(message.header.stamp)
        extra = {'frame': message.header.frame_id}
        rows, columns = cloud.intensity.shape
        view = RayGrid.of(self._lens, rows, columns) if self._lens is not None else None
        if self._previews.is_due:
            few, few_view = thinned(cloud, view, self._given.preview_columns)
            data = encode(Cloud(few.points, few.intensity), few_view, 4.0)  # 1.3 um at 0.8 m
            self._previews.sent(len(data))
            self._put(
                Item(Importance.PREVIEWS, topics.PREVIEW_POINTS, 'cloud', stamp, data, extra=extra)
            )
        started = time.thread_time()
        data = encode(cloud, view)
        self._diagnostics.measure('coding', time.thread_time() - started)
        self._diagnostics.count('clouds')
        self._diagnostics.note('bytes of a cloud', len(data))
        self._put(Item(Importance.CLOUDS, topics.POINTS, 'cloud', stamp, data, extra=extra))

    def send_picture(self, message: Image) -> None:
        """A picture, and a small one before it if it is time for one."""
        image = image_from_message(message)
        stamp = stamp_to_ns(message.header.stamp)
        extra = {'frame': message.header.frame_id}
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        if self._picture_previews.is_due:
            height = round(bgr.shape[0] * 240 / bgr.shape[1])
            small = cv2.resize(bgr, (240, height), interpolation=cv2.INTER_AREA)
            data = _jpeg(small, 50)
            self._picture_previews.sent(len(data))
            self._put(
                Item(Importance.PREVIEWS, topics.PREVIEW_IMAGE, 'jpeg', stamp, data, extra=extra)
            )
        data = _jpeg(bgr, self._given.jpeg_quality)
        self._diagnostics.count('pictures')
        self._diagnostics.note('bytes of a picture', len(data))
        if self._lens is not None:
            extra = {**extra, 'lens': RayGrid(self._lens, 1).numbers()}
        self._put(Item(Importance.PICTURES, topics.IMAGE, 'jpeg', stamp, data, extra=extra))


class Share:
    """When the next of a kind may be sent, so that they take up a share of the link at most.

    Parameters
    ----------
    rate : callable
        byte/s that the link carries; 0 if that is not known.
    share : float
    least : float
        Seconds between two, however fast the link is.
    """

    def __init__(self, rate: Callable[[], float], share: float, least: float = 0.0) -> None:
        self._rate, self._share, self._least = rate, share, least
        self._sent_at, self._size = float('-inf'), 0

    @property
    def is_due(self) -> bool:
        """Whether the next may be sent, by the rate as it is known now."""
        # In the beginning it is known to be far too low.
        rate = self._rate()
        pause = self._size / (self._share * rate) if rate else 0.0
        return time.monotonic() >= self._sent_at + max(self._least, pause)

    def sent(self, size: int) -> None:
        """Note that one of so many bytes was sent."""
        self._sent_at, self._size = time.monotonic(), size


class Thrift:
    """Items that each take the place of the one before, as often as share and period allow.

    Parameters
    ----------
    put : callable
        Takes each item.
    rate : callable
        byte/s that the link carries; 0 if that is not known.
    """

    def __init__(self, put: Callable[[Item], None], rate: Callable[[], float]) -> None:
        self._put = put
        self._shares = {
            topic.name: Share(rate, topic.share or 1.0, topic.period)
            for topic in topics.AS_THEY_ARE.values()
        }
        self._waiting: dict[str, Item] = {}

    def put(self, item: Item) -> None:
        """Send an item, or keep it until its topic's next is due."""
        self._waiting[item.topic] = item
        self.flush()

    def flush(self) -> None:
        """Send what is due."""
        for topic in [topic for topic in self._waiting if self._shares[topic].is_due]:
            item = self._waiting.pop(topic)
            self._shares[topic].sent(len(deflate(item.data)))
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
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._last_state = b''
        self._recordings = Recordings(
            Path(self.given.recordings).expanduser(), self.get_logger().info
        )
        self._capture = self.create_client(Trigger, 'camera_capture/capture')
        self._take_list = self.create_client(Trigger, 'dent_inspector/take_list')
        executive = Executive(
            {
                'capture': lambda: self._call(self._capture),
                'take_list': lambda: self._call(self._take_list),
                'start_recording': self._recordings.start,
                'stop_recording': self._recordings.stop,
            }
        )
        given = self.given
        self.diagnostics.hardware_id = given.address
        self._drone = Drone(
            GroundLink('drone', given.address, given.security, given.name),
            Path(given.spool).expanduser() if given.spool else None,
            given.room * 10**6,
            given.limit * 125,  # byte/s
            executive,
        )
        if not given.keys:
            self.get_logger().warning(f'{given.address}: no keys: whoever reaches it may command')
        self._coder = Coder(self.given, self._put, self._drone.rate, self.diagnostics)
        # Some seconds of a busy machine.
        self._worker = NewestWorker[tuple[Callable[[Any], None], Any]](
            self.diagnostics, self._code, 'a message could not be coded', 8
        )
        self._thrift = Thrift(self._put, self._drone.rate)
        self._state_share = Share(self._drone.rate, 0.25, 1.0)
        for topic in topics.AS_THEY_ARE.values():
            self._forward(topic)
        self.create_timer(1.0, self._thrift.flush, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.create_subscription(
            DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, DIAGNOSTICS
        )
        self.create_subscription(CameraInfo, topics.CAMERA_INFO, self._coder.learn, IMAGES)
        self.create_subscription(
            PointCloud2,
            topics.POINTS,
            lambda message: self._worker.put((self._coder.send_cloud, message)),
            CLOUDS,
            qos_overriding_options=OVERRIDABLE,
        )
        if given.pictures:
            self.create_subscription(
                Image,
                topics.IMAGE,
                lambda message: self._worker.put((self._coder.send_picture, message)),
                IMAGES,
                qos_overriding_options=OVERRIDABLE,
            )

    def destroy_node(self) -> None:
        """End the threads first; what was not sent stays on disk."""
        self._worker.stop(finish=True)
        self._drone.close()
        self._recordings.close()
        super().destroy_node()

    def _forward(self, topic: topics.Topic) -> None:
        kind = f'cdr:{topic.type}'

        def forward(data: bytes) -> None:
            stamp = _stamp_of(data) if topic.stamped else self.now_ns()
            item = Item(topic.importance, topic.name, kind, stamp, data, topic.latest)
            put = self._thrift.put if topic.share or topic.period else self._put
            put(item)

        qos = LATCHED if topic.latest else POSES
        self.create_subscription(message_class(topic.type), topic.name, forward, qos, raw=True)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if len(self._statuses) < 100:
                self._statuses[status.name] = status
        if not self._state_share.is_due:
            return
        array = DiagnosticArray(status=list(self._statuses.values()))
        array.header.stamp = self.get_clock().now().to_msg()
        data = serialize_message(array)
        self._state_share.sent(len(deflate(data, 1, self._last_state)))
        self._last_state = data
        kind = 'cdr:diagnostic_msgs/msg/DiagnosticArray'
        self._put(Item(Importance.STATE, topics.DIAGNOSTICS, kind, self.now_ns(), data))

    def _code(self, task: tuple[Callable[[Any], None], Any]) -> None:
        """Code a cloud or picture, in the worker's thread."""
        code, message = task
        code(message)

    def _put(self, item: Item) -> None:
        self.diagnostics.count('items')
        self._drone.put(item)

    def _call(self, client: Any) -> Answer:
        """Call a service of the payload, in a thread that is not the executor's."""
        if not client.wait_for_service(1.0):
            return Answer(False, f'{client.srv_name} is not there: its node does not run')
        done = threading.Event()
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: done.set())
        if not done.wait(15.0):
            client.remove_pending_request(future)
            return Answer(False, f'{client.srv_name} has not answered within 15 s')
        response = future.result()
        return Answer(bool(response.success), str(response.message))

    def _judge(self) -> tuple[bytes, str]:
        state = self._drone.state()
        self.diagnostics.notes({**state, 'recording': self._recordings.state})
        if trouble := self._drone.trouble():
            return WARN, trouble
        if state['grounds'] == '0':
            return WARN, f'no ground is heard: {state["waiting (MB)"]} MB are kept'
        return OK, f'{state["rate (kbit/s)"]} kbit/s'


def _stamp_of(data: bytes) -> int:
    """Stamp of a serialised message that begins with a header (CDR, after its four bytes)."""
    seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
    return seconds * 1_000_000_000 + nanoseconds


#: Run the node as a process.
main = partial(run, Downlink, 'downlink')


if __name__ == '__main__':
    sys.exit(main())
