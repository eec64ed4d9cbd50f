"""The payload's topics on the ground, out of the items of a drone's downlink.

Commands go the other way, as services.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CompressedImage
from std_srvs.srv import Trigger

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import decode
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.protocol import Item, remember
from ftp_dent_ros.ground.station import Station
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import GroundStationSettings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Verdict
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    cloud_to_message,
    image_to_message,
    make_header,
    pose_from_message,
    stamp_to_ns,
    to_data,
)
from ftp_dent_ros.ros.qos import CLOUDS, LATCHED, POSES

if TYPE_CHECKING:
    from ftp_dent_ros.ground.page.server import PageServer

# Each ends with its command.
_SERVICES = (
    'camera_capture/capture',
    'dent_inspector/take_list',
    'downlink/start_recording',
    'downlink/stop_recording',
)


class GroundTopics:
    """Publishers of all topics that come over the link; a cloud is put into the map here."""

    def __init__(self, node: PayloadNode[Any]) -> None:
        self._diagnostics = node.diagnostics
        self._poses: dict[int, tuple[Pose, str]] = {}
        #: Clouds that wait for their pose.
        self.untagged: dict[int, bytes] = {}
        self._publishers = {
            name: node.create_publisher(message_class(kind), name, CLOUDS)
            for name, kind in topics.MADE_ON_THE_GROUND.items()
        }
        for name, topic in topics.TOPICS.items():
            qos = LATCHED if topic.latest else CLOUDS if topic.coded else POSES
            self._publishers[name] = node.create_publisher(message_class(topic.type), name, qos)

    def publish(self, item: Item) -> None:
        """Publish what an item holds.

        Raises
        ------
        CodecError, PoseError
            It is not what it says.
        """
        topic = topics.TOPICS.get(item.topic)
        if topic is None or item.kind != topic.kind:
            raise CodecError(f'{item.topic} of the kind {item.kind} is no topic of a payload')
        publish = {'cloud': self._publish_cloud, 'jpeg': self._publish_picture}
        publish.get(topic.coded, self._publish_as_it_is)(item)

    def _publish_as_it_is(self, item: Item) -> None:
        publisher = self._publishers[item.topic]
        try:
            message: Any = deserialize_message(item.data, publisher.msg_type)
        except Exception:
            raise CodecError(f'an item of {item.topic} holds no message: it is refused') from None
        publisher.publish(message)
        if item.topic == topics.CAMERA_POSE:
            stamp = stamp_to_ns(message.header.stamp)
            pose = pose_from_message(message.pose.pose), message.header.frame_id
            remember(self._poses, stamp, pose, 100_000)
            if stamp in self.untagged:
                self._publish_tagged(decode(self.untagged.pop(stamp)), stamp)

    def _publish_cloud(self, item: Item) -> None:
        cloud, stamp_ns = decode(item.data), item.stamp_ns
        self._publishers[item.topic].publish(cloud_to_message(cloud, stamp_ns, item.frame))
        if item.topic == topics.PREVIEW_POINTS:
            return
        self._diagnostics.count('clouds')
        if stamp_ns in self._poses:
            self._publish_tagged(cloud, stamp_ns)
        else:
            remember(self.untagged, stamp_ns, item.data, 200)

    def _publish_tagged(self, cloud: Cloud, stamp_ns: int) -> None:
        pose, frame = self._poses.pop(stamp_ns)
        message = cloud_to_message(cloud.transformed(pose), stamp_ns, frame)
        self._publishers[topics.TAGGED_POINTS].publish(message)
        self._diagnostics.count('tagged clouds')

    def _publish_picture(self, item: Item) -> None:
        pixels = np.frombuffer(item.data, np.uint8)
        if item.topic == topics.PREVIEW_IMAGE:
            header = make_header(item.stamp_ns, item.frame)
            picture = CompressedImage(header=header, format='jpeg', data=to_data(pixels))
            self._publishers[item.topic].publish(picture)
            return
        bgr = cv2.imdecode(pixels, cv2.IMREAD_COLOR)
        if bgr is None:
            raise CodecError('a picture is no JPEG')
        self._diagnostics.count('pictures')
        rgb = np.ascontiguousarray(bgr[..., ::-1], np.uint8)
        self._publishers[item.topic].publish(image_to_message(rgb, item.stamp_ns, item.frame))
        size = (rgb.shape[1], rgb.shape[0])
        info = camera_info_message(item.lens, size, item.stamp_ns, item.frame)
        self._publishers[topics.CAMERA_INFO].publish(info)


class GroundStation(PayloadNode[GroundStationSettings]):
    """Node that publishes what a drone's downlink sends, and passes commands up."""

    threads = 4

    def _set_up(self) -> None:
        given = self.given
        self._drone_is_here = False
        self._topics = GroundTopics(self)
        self._queue: queue.Queue[Item | None] = queue.Queue(64)
        self.diagnostics.hardware_id = given.address
        self._page: PageServer | None = None
        link = GroundLink('ground', given.address, given.security, given.name)
        self._station = Station(link, self._queue.put, given.station)
        self.ending.callback(self._station.close)
        if given.web:
            # Only who wants a page needs aiohttp.
            from ftp_dent_ros.ground.page.server import PageServer

            self._page = PageServer(given.web, self._station)
            self.ending.callback(self._page.close)
            self.get_logger().info(f'what comes is shown at {self._page.url}')
            self.get_logger().info(f'for Foxglove it is at {self._page.foxglove_url}')
        worker = threading.Thread(target=self._run, name='decoding', daemon=True)
        worker.start()
        self.ending.callback(worker.join, 5.0)
        self.ending.callback(self._queue.put, None)
        group = ReentrantCallbackGroup()
        for name in _SERVICES:
            do = partial(self._do, name.rpartition('/')[2])
            self.create_service(Trigger, name, do, callback_group=group)

    def _do(
        self, command: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        answer = self._station.command(command)
        if not answer.success:
            self.diagnostics.refuse(f'{command} failed', answer.message)
        response.success, response.message = answer.success, answer.message
        return response

    def _run(self) -> None:
        """Publish item after item, in a thread of its own; nothing that they hold ends it."""
        # What is published before subscribers have found the publishers nobody hears.
        time.sleep(1.5)
        while (item := self._queue.get()) is not None:
            with self.diagnostics.guarded('an item could not be published', 'wrong item'):
                if self._page is not None:
                    self._page.take(item)
                self.diagnostics.count('items')
                age = (self.now_ns() - item.stamp_ns) / 1e9
                if 0 <= age < 60.0 * 60.0:
                    self.diagnostics.count(f'delay of {item.importance.name.lower()}', age)
                if not self._drone_is_here:
                    self._topics.publish(item)

    def _judge(self) -> Sequence[Verdict]:
        waiting = {'clouds waiting for their pose': len(self._topics.untagged)}
        self.diagnostics.note({**self._station.state(), **waiting})
        self._drone_is_here = 'downlink' in self.get_node_names()
        if not self._drone_is_here and (change := self._station.change()):
            self.get_logger().info(change)
        level, text = self._station.summary()
        here = (
            'the payload itself is in this ROS domain, so that nothing of it is published '
            'twice: choose another ROS_DOMAIN_ID for the ground'
        )
        return (self._drone_is_here, ERROR, here), (level, WARN, text), (True, OK, text)
