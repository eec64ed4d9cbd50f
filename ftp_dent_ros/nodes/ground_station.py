"""The payload's topics on the ground, out of the items of a drone's downlink.

Commands go the other way, as services.
"""

from __future__ import annotations

import queue
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_srvs.srv import Trigger

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import RayGrid, decode
from ftp_dent_ros.coding.compressed_depth import FORMAT, depth_image
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.page import serve_page
from ftp_dent_ros.ground.protocol import Item
from ftp_dent_ros.ground.station import Station
from ftp_dent_ros.nodes.payload_node import PayloadNode
from ftp_dent_ros.nodes.settings import GroundStationSettings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    cloud_to_message,
    image_to_message,
    make_header,
    pose_from_message,
    stamp_to_ns,
    to_data,
)
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.qos import CLOUDS, DIAGNOSTICS, IMAGES, LATCHED, POSES

# The command of each service.
_SERVICES = {
    'camera_capture/capture': 'capture',
    'dent_inspector/take_list': 'take_list',
    'downlink/start_recording': 'start_recording',
    'downlink/stop_recording': 'stop_recording',
}


class GroundTopics:
    """Publishers of all topics that come over the link; a cloud is put into the map here.

    Parameters
    ----------
    node : Node
    diagnostics : Diagnostics
    """

    def __init__(self, node: Node, diagnostics: Diagnostics) -> None:
        self._diagnostics = diagnostics
        self._poses: OrderedDict[int, tuple[Pose, str]] = OrderedDict()
        self._untagged: OrderedDict[int, bytes] = OrderedDict()
        kinds: list[tuple[str, Any, QoSProfile]] = [
            (topic.name, message_class(topic.type), LATCHED if topic.latest else POSES)
            for topic in topics.AS_THEY_ARE.values()
        ]
        kinds += [
            (topics.DIAGNOSTICS, DiagnosticArray, DIAGNOSTICS),
            (topics.POINTS, PointCloud2, CLOUDS),
            (topics.TAGGED_POINTS, PointCloud2, CLOUDS),
            (topics.PREVIEW_POINTS, PointCloud2, CLOUDS),
            (topics.PREVIEW_IMAGE, CompressedImage, IMAGES),
            (topics.DEPTH, CompressedImage, IMAGES),
            (topics.IMAGE, Image, IMAGES),
            (topics.CAMERA_INFO, CameraInfo, IMAGES),
        ]
        self._publishers = {
            name: node.create_publisher(kind, name, qos) for name, kind, qos in kinds
        }
        self._publish_as: dict[str, tuple[str, Callable[[Item, str], None]]] = {
            topics.POINTS: ('cloud', self._publish_cloud),
            topics.PREVIEW_POINTS: ('cloud', self._publish_preview),
            topics.IMAGE: ('jpeg', self._publish_picture),
            topics.PREVIEW_IMAGE: ('jpeg', self._publish_small_picture),
        }
        for name in (*topics.AS_THEY_ARE, topics.DIAGNOSTICS):
            kind = f'cdr:{_type_name(self._publishers[name].msg_type)}'
            self._publish_as[name] = kind, self._publish_as_it_is

    @property
    def untagged(self) -> int:
        """How many clouds wait for their pose."""
        return len(self._untagged)

    def publish(self, item: Item) -> None:
        """Publish what an item holds.

        Raises
        ------
        CodecError, PoseError
            It is not what it says.
        """
        kind, publish = self._publish_as.get(item.topic, ('', self._publish_as_it_is))
        if item.kind != kind:
            raise CodecError(f'{item.topic} of the kind {item.kind} is no topic of a payload')
        publish(item, str(item.extra.get('frame', '')))

    def _publish_as_it_is(self, item: Item, _: str) -> None:
        publisher = self._publishers[item.topic]
        message = _deserialised(item.data, publisher.msg_type)
        publisher.publish(message)
        if item.topic == topics.CAMERA_POSE:
            self._take_pose(message)

    def _take_pose(self, message: PoseWithCovarianceStamped) -> None:
        stamp = stamp_to_ns(message.header.stamp)
        self._poses[stamp] = pose_from_message(message.pose.pose), message.header.frame_id
        while len(self._poses) > 100_000:
            self._poses.popitem(last=False)
        waiting = self._untagged.pop(stamp, None)
        if waiting is not None:
            self._publish_tagged(decode(waiting), stamp)

    def _publish_preview(self, item: Item, frame: str) -> None:
        message = cloud_to_message(decode(item.data), item.stamp_ns, frame)
        self._publishers[item.topic].publish(message)

    def _publish_cloud(self, item: Item, frame: str) -> None:
        cloud = decode(item.data)
        self._diagnostics.count('clouds')
        self._publishers[item.topic].publish(cloud_to_message(cloud, item.stamp_ns, frame))
        if self._publishers[topics.DEPTH].get_subscription_count():
            self._publish_compressed(
                topics.DEPTH, item.stamp_ns, frame, FORMAT, depth_image(cloud)
            )
        if item.stamp_ns in self._poses:
            self._publish_tagged(cloud, item.stamp_ns)
            return
        self._untagged[item.stamp_ns] = item.data
        while len(self._untagged) > 200:
            self._untagged.popitem(last=False)

    def _publish_tagged(self, cloud: Cloud, stamp_ns: int) -> None:
        pose, frame = self._poses.pop(stamp_ns)
        message = cloud_to_message(cloud.transformed(pose), stamp_ns, frame)
        self._publishers[topics.TAGGED_POINTS].publish(message)
        self._diagnostics.count('tagged clouds')

    def _publish_compressed(
        self, topic: str, stamp_ns: int, frame: str, kind: str, data: bytes
    ) -> None:
        values = to_data(np.frombuffer(data, np.uint8))
        header = make_header(stamp_ns, frame)
        self._publishers[topic].publish(CompressedImage(header=header, format=kind, data=values))

    def _publish_small_picture(self, item: Item, frame: str) -> None:
        self._publish_compressed(item.topic, item.stamp_ns, frame, 'jpeg', item.data)

    def _publish_picture(self, item: Item, frame: str) -> None:
        bgr = cv2.imdecode(np.frombuffer(item.data, np.uint8), cv2.IMREAD_COLOR)
        if bgr is None:
            raise CodecError('a picture is no JPEG')
        self._diagnostics.count('pictures')
        rgb = np.ascontiguousarray(bgr[..., ::-1], np.uint8)
        self._publishers[item.topic].publish(image_to_message(rgb, item.stamp_ns, frame))
        lens = None
        if 'lens' in item.extra:
            try:
                lens = RayGrid.from_numbers(item.extra['lens']).lens
            except (ValueError, TypeError):
                raise CodecError('a picture has a malformed lens') from None
        info = camera_info_message(lens, (rgb.shape[1], rgb.shape[0]), item.stamp_ns, frame)
        self._publishers[topics.CAMERA_INFO].publish(info)


def _type_name(kind: Any) -> str:
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


def _deserialised(data: bytes, kind: Any) -> Any:
    """Message of CDR."""
    try:
        return deserialize_message(data, kind)
    except Exception:
        raise CodecError(f'an item holds no {_type_name(kind)}: it is refused') from None


class GroundStation(PayloadNode[GroundStationSettings]):
    """Node that publishes what a drone's downlink sends, and passes commands up."""

    def __init__(self, **options: Any) -> None:
        super().__init__('ground_station', **options)
        given = self.given
        self._drone_is_here = False
        self._ending = threading.Event()
        self._topics = GroundTopics(self, self.diagnostics)
        self._queue: queue.Queue[Item | None] = queue.Queue(64)
        self.diagnostics.hardware_id = given.address
        self._station = Station(
            GroundLink('ground', given.address, given.security, given.name),
            self._queue.put,
            given.station,
        )
        self._page = None
        try:
            if given.web:
                self._page = serve_page(given.web, self._station)
                self.get_logger().info(f'what comes is shown at {self._page.url}')
                self.get_logger().info(f'for Foxglove it is at {self._page.foxglove_url}')
        except ConfigurationError:
            # The link's threads would keep the process.
            self._close()
            raise
        self._worker = threading.Thread(target=self._run, name='decoding', daemon=True)
        self._worker.start()
        group = ReentrantCallbackGroup()
        for name, command in _SERVICES.items():
            self.create_service(Trigger, name, self._commander(command), callback_group=group)

    def destroy_node(self) -> None:
        """End the link and the thread first."""
        self._ending.set()
        self._queue.put(None)
        self._worker.join(5.0)
        self._close()
        super().destroy_node()

    def _close(self) -> None:
        if self._page is not None:
            self._page.close()
        self._station.close()

    def _commander(self, command: str):
        def do(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            answer = self._station.command(command)
            if not answer.success:
                self.diagnostics.refuse(f'{command} failed', answer.message)
            response.success, response.message = answer.success, answer.message
            return response

        return do

    def _run(self) -> None:
        """Publish item after item, in a thread of its own; nothing that they hold ends it."""
        # What is published before subscribers have found the publishers nobody hears.
        self._ending.wait(1.5)
        while (item := self._queue.get()) is not None:
            with self.diagnostics.guarded('an item could not be published', 'wrong item'):
                if self._page is not None:
                    self._page.take(item)
                self._publish(item)

    def _publish(self, item: Item) -> None:
        self.diagnostics.count('items')
        age = (self.now_ns() - item.stamp_ns) / 1e9
        if 0 <= age < 60.0 * 60.0:
            self.diagnostics.measure(f'delay of {item.importance.name.lower()}', age)
        if not self._drone_is_here:
            self._topics.publish(item)

    def _judge(self) -> tuple[bytes, str]:
        waiting = {'clouds waiting for their pose': self._topics.untagged}
        self.diagnostics.notes({**self._station.state(), **waiting})
        self._drone_is_here = 'downlink' in self.get_node_names()
        if self._drone_is_here:
            return ERROR, (
                'the payload itself is in this ROS domain, so that nothing of it is published '
                'twice: choose another ROS_DOMAIN_ID for the ground'
            )
        if change := self._station.change():
            self.get_logger().info(change)
        level, text = self._station.summary()
        return (WARN if level else OK), text


#: Run the node as a process.
main = partial(run, GroundStation, 'ground_station', threads=4)


if __name__ == '__main__':
    sys.exit(main())
