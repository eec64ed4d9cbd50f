"""``ftp-dent record``: topics to an MCAP bag, as ``ros2 bag record`` does it.

A message is in the kernel's hands as soon as the writer's thread gets to it, and only then is it
counted: a recorder that is killed loses nothing that it has counted, and ``ftp-dent recover``
gives it all back. A power cut costs the last two seconds.
"""

from __future__ import annotations

import argparse
import threading
import time
from contextlib import closing
from pathlib import Path

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ftp_dent_ros.cli import argument
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import BagError, ConfigurationError
from ftp_dent_ros.recording.topic import (
    Message,
    Qos,
    absolute_names,
    is_hidden,
    known_topic,
)
from ftp_dent_ros.recording.writer import BagSpool, BagWriter
from ftp_dent_ros.ros.qos import AnySubscription
from ftp_dent_ros.ros.session import say, session

# Memory for messages that wait for the disk, bytes: half a minute of a flight.
_CAPACITY = 512_000_000


ARGUMENTS = (
    argument('names', nargs='*', metavar='TOPIC', help='topics to record'),
    argument('--topics', nargs='+', default=[], metavar='TOPIC', help='more of them'),
    argument('-a', '--all', action='store_true', help='every topic, also later ones'),
    argument(
        '-o', '--output', type=Path, help='folder of the bag: must not exist (default: by time)'
    ),
    argument(
        '--compress',
        action='store_true',
        help='clouds to half of their own uncertainty, pictures as JPEG: a fifteenth of the size',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Record until SIGINT or SIGTERM, or until the disk is full."""
    names = absolute_names([*arguments.names, *arguments.topics])
    if not names and not arguments.all:
        raise ConfigurationError('nothing to record: name topics, or give --all')
    output = arguments.output or Path(time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))
    with session('recorder') as (node, stop):
        writer = _writer(arguments, output)
        spool = BagSpool(writer, _CAPACITY)
        recorder = Recorder(node, spool, names, arguments.all)
        start = time.monotonic()
        with closing(spool):
            _receive(node, recorder, spool, stop)
    total = (
        f'{writer.message_count} messages, {writer.size / 1e6:.1f} MB '
        f'in {time.monotonic() - start:.1f} s'
    )
    for name in recorder.missing():
        say(f'{name}: not recorded, for nobody published it')
    if recorder.lost or spool.dropped:
        say(
            f'{recorder.lost} messages were lost on the way here, and {spool.dropped} dropped '
            'because the disk was too slow or full: record fewer topics, or to a faster disk'
        )
    if isinstance(spool.error, BagError):
        raise BagError(
            f'{spool.error}; the recording ends after {total}: '
            f'make it whole with `ftp-dent recover {output} --output NEW` on a disk with room'
        )
    if spool.error is not None:
        raise spool.error
    print(f'{output}: {total}, {len(writer.topics)} topics')
    return 0


def _writer(arguments: argparse.Namespace, output: Path) -> BagWriter:
    if not arguments.compress:
        return BagWriter(output)
    from ftp_dent_ros.recording.compression import CompressedBagWriter

    return CompressedBagWriter(output)


def _receive(node: Node, recorder: Recorder, spool: BagSpool, stop: threading.Event) -> None:
    """Take what comes until it is enough, and say every five seconds how much that is."""
    shown = time.monotonic()
    with SingleThreadedExecutor() as executor:
        executor.add_node(node)
        while not (stop.is_set() or spool.error):
            executor.spin_once(timeout_sec=_DISCOVERY_S)
            if time.monotonic() - shown > 5.0:
                shown = time.monotonic()
                say(f'{spool.writer.message_count} messages, {spool.writer.size / 1e6:.1f} MB')
        # What had arrived when the signal came is taken too.
        end = time.monotonic() + 1.0
        before = -1
        while recorder.received != before and time.monotonic() < end:
            before = recorder.received
            for _ in range(5):  # some turns go to timers and events
                executor.spin_once(timeout_sec=0.0)


_DISCOVERY_S = 0.1


class Recorder:
    """Subscribes to the topics wanted as they appear, and hands on what comes.

    Parameters
    ----------
    node : Node
        Spun by the caller.
    spool : BagSpool
        Takes each message; its writer each topic before its first one.
    names : tuple of str
        Topics wanted in any case, absolute.
    everything : bool
        Whether all that are not hidden are wanted, too.

    Attributes
    ----------
    received : int
        Messages that came.
    """

    def __init__(
        self, node: Node, spool: BagSpool, names: tuple[str, ...], everything: bool
    ) -> None:
        self.received = 0
        self._node, self._spool = node, spool
        self._names, self._everything = names, everything
        # Of each topic that was met; None where ROS refuses it.
        self._subscriptions: dict[str, AnySubscription | None] = {}
        node.create_timer(_DISCOVERY_S, self.discover)
        self.discover()

    @property
    def lost(self) -> int:
        """Messages that did not come."""
        return sum(each.lost for each in self._subscriptions.values() if each is not None)

    def discover(self) -> None:
        """Subscribe to new topics."""
        for name, _ in self._node.get_topic_names_and_types():
            wanted = name in self._names or (self._everything and not is_hidden(name))
            if wanted and name not in self._subscriptions:
                publishers = self._node.get_publishers_info_by_topic(name)
                if publishers:
                    self._subscriptions[name] = self._begin(name, publishers)

    def missing(self) -> list[str]:
        """Topics that were wanted by name and have not appeared."""
        return [name for name in self._names if name not in self._subscriptions]

    def _begin(self, name: str, publishers: list[TopicEndpointInfo]) -> AnySubscription | None:
        """Record a topic, of the type that its first publisher has."""
        kind, announced = publishers[0].topic_type, str(publishers[0].topic_type_hash)
        profiles = [each.qos_profile for each in publishers if each.topic_type == kind]
        offered = tuple(
            Qos(
                ReliabilityPolicy(each.reliability).short_key,
                DurabilityPolicy(each.durability).short_key,
            )
            for each in profiles
        )
        topic = known_topic(name, kind, offered, announced if announced.startswith('RIHS') else '')

        def take(data: bytes, info: dict[str, int | None]) -> None:
            self.received += 1
            received = info['received_timestamp'] or time.time_ns()
            published = info['source_timestamp'] or received
            sequence = (info['publication_sequence_number'] or 0) & 0xFFFFFFFF
            self._spool.put(Message(name, kind, received, published, data, sequence))

        # Messages that wait in DDS while this process is held up: few images and clouds, which
        # would fill the memory.
        large = any(line.startswith('uint8[] ') for line in topic.definition.splitlines())
        try:
            subscription = AnySubscription(
                self._node, message_class(kind), name, take, 20 if large else 1000, raw=True
            )
        except Exception as reason:  # an unknown type, or rclpy's own: a name that is not ROS's
            say(f'{name}: not recorded: {str(reason).splitlines()[0].rstrip(":")}')
            return None
        self._spool.writer.add_topic(topic)
        say(f'recording {name} [{kind}]')
        return subscription
