"""The payload's topics on the ground: same names, types, stamps and quality of service.

What comes over the link is published in the ground's own ROS domain, so that RViz, Foxglove,
``ros2 bag`` and the dent inspector work as beside the drone. The payload's services that command
it are there too.
"""

from __future__ import annotations

import queue
import sys
import threading
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger

from ftp_dent_ros.errors import ConfigurationError, InputError, PoseError
from ftp_dent_ros.ground.link import Link
from ftp_dent_ros.ground.page import serve_page
from ftp_dent_ros.ground.protocol import Item
from ftp_dent_ros.ground.station import Station
from ftp_dent_ros.nodes.declarations import names_of_all
from ftp_dent_ros.nodes.ground_parameters import declare
from ftp_dent_ros.nodes.ground_topics import GroundTopics
from ftp_dent_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from ftp_dent_ros.ros.node import run
from ftp_dent_ros.ros.parameters import Parameters

# Items that wait to be decoded: the link waits for no decoding.
_QUEUE = 64
_DISCOVERY = 1.5  # seconds
# The command of each service.
_SERVICES = {
    'camera_capture/capture': 'capture',
    'dent_inspector/take_list': 'take_list',
    'downlink/start_recording': 'start_recording',
    'downlink/stop_recording': 'stop_recording',
}


class GroundStation(Node):
    """Node that publishes what a drone's downlink sends, and passes commands up."""

    def __init__(self, **options: Any) -> None:
        super().__init__('ground_station', **options)
        parameters = Parameters(self)
        given = declare(parameters)
        parameters.close(names_of_all)
        self._drone_is_here = False
        self._ending = threading.Event()
        self._diagnostics = Diagnostics(self, self._judge, hardware_id=given.link.address)
        self._topics = GroundTopics(self, self._diagnostics)
        self._queue: queue.Queue[Item | None] = queue.Queue(_QUEUE)
        link = given.link
        self._station = Station(
            Link('ground', link.address, link.security, link.name),
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
                self._diagnostics.refuse(f'{command} failed', answer.message)
            response.success, response.message = answer.success, answer.message
            return response

        return do

    def _run(self) -> None:
        """Publish item after item, in a thread of its own; nothing that they hold ends it."""
        # What is published before subscribers have found the publishers nobody hears.
        self._ending.wait(_DISCOVERY)
        while (item := self._queue.get()) is not None:
            self._publish_or_refuse(item)

    def _publish_or_refuse(self, item: Item) -> None:
        try:
            if self._page is not None:
                self._page.take(item)
            self._publish(item)
        except (InputError, PoseError) as error:
            self._diagnostics.refuse('wrong item', str(error))
        except Exception as error:
            self._diagnostics.fail_by_defect('an item could not be published', error)

    def _publish(self, item: Item) -> None:
        self._diagnostics.count('items')
        age = (self._now_ns() - item.stamp_ns) / 1e9
        if 0 <= age < 60.0 * 60.0:
            self._diagnostics.measure(f'delay of {item.importance.name.lower()}', age)
        if self._drone_is_here:
            return
        self._topics.publish(item)

    def _judge(self) -> tuple[bytes, str]:
        for name, value in self._station.state().items():
            self._diagnostics.note(name, value)
        self._diagnostics.note('clouds waiting for their pose', self._topics.untagged)
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

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def main() -> int:
    """Run the node as a process."""
    return run(GroundStation, 'ground_station', threads=4)


if __name__ == '__main__':
    sys.exit(main())
