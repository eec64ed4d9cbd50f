"""The payload's topics to the ground, as a thin and unreliable link allows.

What is most important goes first: state, dents, poses, previews, then whole clouds and pictures.
What cannot be sent now is kept and sent when the link is better. Commands of the ground are done
once each. The payload never waits for any of this.
"""

from __future__ import annotations

import queue
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import InputError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.commands import Answer, Executive, Recordings
from ftp_dent_ros.ground.drone import Drone
from ftp_dent_ros.ground.link import Link
from ftp_dent_ros.ground.protocol import Importance, Item, deflate
from ftp_dent_ros.nodes.declarations import names_of_all
from ftp_dent_ros.nodes.downlink_coder import Coder, Thrift, pause_after
from ftp_dent_ros.nodes.downlink_parameters import declare
from ftp_dent_ros.ros.diagnostics import OK, WARN, Diagnostics
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.qos import CLOUDS, DIAGNOSTICS, IMAGES, LATCHED, OVERRIDABLE, POSES

# Clouds and pictures that may wait to be coded: some seconds of a busy machine.
_WAITING = 8
# Of the link's rate, what state may take up, and how often at most (s).
_STATE_SHARE, _STATE_PERIOD = 0.25, 1.0
# For a service of another node to answer (s).
_PATIENCE = 15.0


class _NeverWoken(CallbackGroup):
    """Of subscriptions that no executor waits for."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        return


class Downlink(Node):
    """Node that sends what the payload publishes to the ground."""

    def __init__(self, **options: Any) -> None:
        super().__init__('downlink', **options)
        parameters = Parameters(self)
        self._given = declare(parameters)
        parameters.close(names_of_all)
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._next_state = 0.0
        self._last_state = b''
        self._diagnostics = Diagnostics(self, self._judge, hardware_id=self._given.link.address)
        self._recordings = Recordings(self._given.recordings, self.get_logger().info)
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
        link = self._given.link
        self._drone = Drone(
            Link('drone', link.address, link.security, link.name),
            self._given.folder,
            self._given.room,
            self._given.limit,
            executive,
        )
        if link.security.keys is None:
            self.get_logger().warning(f'{link.address}: no keys: whoever reaches it may command')
        self._coder = Coder(self._given, self._put, self._drone.rate, self._diagnostics)
        self._queue: queue.Queue[tuple[Callable[[Any], None], Any] | None]
        self._queue = queue.Queue(_WAITING)
        self._worker = threading.Thread(target=self._run, name='coding', daemon=True)
        self._worker.start()
        self._thrift = Thrift(self._put, self._drone.rate)
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
            lambda message: self._hand_over(self._coder.send_cloud, message),
            CLOUDS,
            qos_overriding_options=OVERRIDABLE,
        )
        if self._given.pictures:
            self.create_subscription(
                Image,
                topics.IMAGE,
                lambda message: self._hand_over(self._coder.send_picture, message),
                IMAGES,
                qos_overriding_options=OVERRIDABLE,
            )

    def destroy_node(self) -> None:
        """End the threads first; what was not sent stays on disk."""
        self._queue.put(None)
        self._worker.join(5.0)
        self._drone.close()
        self._recordings.close()
        super().destroy_node()

    def _forward(self, topic: topics.Topic) -> None:
        kind = f'cdr:{topic.type}'

        def forward(data: bytes) -> None:
            stamp = _stamp_of(data) if topic.stamped else self._now_ns()
            item = Item(topic.importance, topic.name, kind, stamp, data, topic.latest)
            if topic.share:
                self._thrift.put(item, topic.share)
            else:
                self._put(item)

        if not topic.period:
            qos = LATCHED if topic.latest else POSES
            self.create_subscription(message_class(topic.type), topic.name, forward, qos, raw=True)
            return
        # The newest is taken when one is due: to be woken fifty times a second is dear.
        subscription = self.create_subscription(
            message_class(topic.type),
            topic.name,
            forward,
            QoSProfile(depth=1),
            raw=True,
            callback_group=_NeverWoken(),
        )

        def take() -> None:
            with subscription.handle:
                found = subscription.handle.take_message(subscription.msg_type, True)
            if found is not None:
                forward(found[0])

        self.create_timer(topic.period, take, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if len(self._statuses) < 100:
                self._statuses[status.name] = status
        now = time.monotonic()
        if now < self._next_state:
            return
        array = DiagnosticArray(status=list(self._statuses.values()))
        array.header.stamp = self.get_clock().now().to_msg()
        data = serialize_message(array)
        size = len(deflate(data, 1, self._last_state))
        pause = pause_after(size, self._drone.rate(), _STATE_SHARE, _STATE_PERIOD)
        self._next_state, self._last_state = now + pause, data
        kind = 'cdr:diagnostic_msgs/msg/DiagnosticArray'
        self._put(Item(Importance.STATE, topics.DIAGNOSTICS, kind, self._now_ns(), data))

    def _hand_over(self, work: Callable[[Any], None], message: Any) -> None:
        try:
            self._queue.put_nowait((work, message))
        except queue.Full:
            self._diagnostics.count('dropped before they were coded')

    def _run(self) -> None:
        """Code clouds and pictures, in a thread of its own; nothing that they hold ends it."""
        while (task := self._queue.get()) is not None:
            work, message = task
            try:
                work(message)
            except InputError as error:
                self._diagnostics.refuse('wrong message', str(error))
            except Exception as error:
                self._diagnostics.fail_by_defect('a message could not be coded', error)

    def _put(self, item: Item) -> None:
        self._diagnostics.count('items')
        self._drone.put(item)

    def _call(self, client: Any) -> Answer:
        """Call a service of the payload, in a thread that is not the executor's."""
        if not client.wait_for_service(1.0):
            return Answer(False, f'{client.srv_name} is not there: its node does not run')
        done = threading.Event()
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: done.set())
        if not done.wait(_PATIENCE):
            client.remove_pending_request(future)
            return Answer(False, f'{client.srv_name} has not answered within {_PATIENCE:g} s')
        response = future.result()
        return Answer(bool(response.success), str(response.message))

    def _judge(self) -> tuple[bytes, str]:
        state = self._drone.state()
        for name, value in state.items():
            self._diagnostics.note(name, value)
        self._diagnostics.note('recording', self._recordings.state)
        if trouble := self._drone.trouble():
            return WARN, trouble
        if state['grounds'] == '0':
            return WARN, f'no ground is heard: {state["waiting (MB)"]} MB are kept'
        return OK, f'{state["rate (kbit/s)"]} kbit/s'

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def _stamp_of(data: bytes) -> int:
    """Stamp of a serialised message that begins with a header (CDR, after its four bytes)."""
    seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
    return seconds * 1_000_000_000 + nanoseconds


def main() -> int:
    """Run the node as a process."""
    return run(Downlink, 'downlink')


if __name__ == '__main__':
    sys.exit(main())
