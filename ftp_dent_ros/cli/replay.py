"""``ftp-dent replay``: publishes the messages of a bag, byte for byte, at their original times."""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.signals import SignalHandlerOptions
from tqdm import tqdm

from ftp_dent_ros.errors import BagError, ConfigurationError
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.recording.selection import Selection
from ftp_dent_ros.recording.topic import Message, Topic
from ftp_dent_ros.ros.bags import message_class, offer_for
from ftp_dent_ros.ros.signals import stop_on_signal

_DEPTH = 20
_PATIENCE_S = 5.0  # with a subscriber that does not acknowledge
_SETTLED_S = 0.5  # discovery is taken to be over when it has been quiet for so long


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('bag', type=Path, help='folder of the bag, or an .mcap file')
    parser.add_argument(
        '-r', '--rate', type=_positive, default=1.0, help='times the original speed; inf: at once'
    )
    parser.add_argument('-l', '--loop', action='store_true', help='begin again at the end')
    parser.add_argument(
        '--topics', nargs='+', default=[], metavar='TOPIC', help='only these (default: all)'
    )
    parser.add_argument('-e', '--regex', default='', help='only topics whose name matches')
    parser.add_argument('-x', '--exclude-regex', default='', help='no topics whose name matches')
    parser.add_argument(
        '--start-offset',
        type=_seconds,
        default=0.0,
        metavar='SECONDS',
        help='begin so far into the bag; latched messages from before are published first',
    )
    parser.add_argument(
        '-m',
        '--remap',
        nargs='+',
        default=[],
        metavar='OLD:=NEW',
        help='publish under other names',
    )
    parser.add_argument(
        '--wait-for-subscribers',
        action='store_true',
        help='begin when every topic has a subscriber',
    )


def run(arguments: argparse.Namespace) -> int:
    """Replay until the end, or until SIGINT or SIGTERM."""
    bag = open_bag(arguments.bag)
    topics = _chosen(bag, arguments)
    remaps = [word for rule in arguments.remap for word in ('-r', rule)]
    with stop_on_signal() as stop:
        rclpy.init(args=['--ros-args', *remaps], signal_handler_options=SignalHandlerOptions.NO)
        node = Node('player', enable_rosout=False, start_parameter_services=False)
        try:
            player = Player(node, bag, topics, stop)
            player.wait_for_subscribers(all_of_them=arguments.wait_for_subscribers)
            start = time.monotonic()
            while True:
                player.play(arguments.rate, round(arguments.start_offset * 1e9))
                if stop.is_set() or not arguments.loop:
                    break
            player.wait_for_acknowledgements()
            print(
                f'{arguments.bag}: {player.published} messages of {len(player.topics)} topics '
                f'in {time.monotonic() - start:.1f} s'
            )
        finally:
            node.destroy_node()
            rclpy.try_shutdown()
    return 0


class Player:
    """Publishes a bag's messages with the quality of service that they were recorded with.

    Never more than a publisher's history are unacknowledged, so that reliable subscriptions get
    every message, whatever the rate.

    Parameters
    ----------
    node : Node
        Need not be spun.
    bag : Bag
        What to play.
    topics : list of Topic
        Those of it that are wanted.
    stop : threading.Event
        Ends whatever is going on.

    Attributes
    ----------
    topics : list of str
        Names, in the bag, of the topics that are published.
    published : int
        Messages so far.

    Raises
    ------
    BagError
        None of the topics can be published.
    """

    def __init__(self, node: Node, bag: Bag, topics: list[Topic], stop: threading.Event) -> None:
        self.published = 0
        self._bag = bag
        self._stop = stop
        self._publishers: dict[str, Publisher] = {}
        self._unacknowledged: dict[str, int] = {}
        for topic in topics:
            try:
                self._publishers[topic.name] = _make_publisher(node, topic)
            except ConfigurationError as error:
                _say(f'{topic.name}: not replayed: {error}')
        if topics and not self._publishers:
            raise BagError(f'{bag.path}: none of its topics can be replayed here: see above')

    @property
    def topics(self) -> list[str]:
        """Names, in the bag, of the topics that are published."""
        return list(self._publishers)

    def wait_for_subscribers(self, all_of_them: bool) -> None:
        """Wait until discovery has settled, or until every topic has a subscriber."""
        counts: dict[str, int] = {}
        quiet_since = told = time.monotonic()
        while not self._stop.wait(0.02):
            now = time.monotonic()
            new = {name: each.get_subscription_count() for name, each in self._publishers.items()}
            if new != counts:
                counts, quiet_since = new, now
            missing = sorted(name for name, count in counts.items() if not count)
            if now - quiet_since >= _SETTLED_S and not (all_of_them and missing):
                return
            if missing and all_of_them and now - told >= 2:
                _say(f'waiting for subscribers of {", ".join(missing)}')
                told = now

    def play(self, rate: float, offset_ns: int) -> None:
        """Play once from `offset_ns` into the bag."""
        start_ns = self._bag.metadata.start_ns + offset_ns
        for message in self._latched_before(start_ns) if offset_ns else ():
            self._publish(message)
        counts = self._bag.metadata.message_counts
        total = None if offset_ns else sum(counts[name] for name in self._publishers)
        start = time.monotonic()
        with tqdm(total=total, unit=' messages', disable=None) as bar:
            for message in self._bag.messages(self.topics, start_ns):
                due = start + (message.log_time_ns - start_ns) / 1e9 / rate
                # The event is looked at also where nothing is to be waited for.
                if self._stop.wait(max(0.0, due - time.monotonic())):
                    return
                self._publish(message)
                bar.update()

    def wait_for_acknowledgements(self) -> None:
        """Wait until reliable subscriptions have everything, or have been silent for long."""
        for name in self._publishers:
            self._wait_for_acknowledgement(name)

    def _publish(self, message: Message) -> None:
        publisher = self._publishers[message.topic]
        publisher.publish(message.data)
        self.published += 1
        count = self._unacknowledged.get(message.topic, 0) + 1
        self._unacknowledged[message.topic] = count
        # What is latched sets the scene for what follows.
        latched = publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        if latched or count >= _DEPTH:
            self._wait_for_acknowledgement(message.topic)

    def _wait_for_acknowledgement(self, name: str) -> None:
        end = time.monotonic() + _PATIENCE_S
        while not self._publishers[name].wait_for_all_acked(Duration(nanoseconds=50_000_000)):
            if self._stop.is_set() or time.monotonic() > end:
                return
        self._unacknowledged[name] = 0

    def _latched_before(self, start_ns: int) -> Iterator[Message]:
        """The last message before a time of each latched topic."""
        latched = [
            name
            for name, publisher in self._publishers.items()
            if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        ]
        last: dict[str, Message] = {}
        for message in self._bag.messages(latched) if latched else ():
            if message.log_time_ns >= start_ns:
                break
            last[message.topic] = message
        yield from last.values()


def _make_publisher(node: Node, topic: Topic) -> Publisher:
    publisher = node.create_publisher(
        message_class(topic.type), topic.name, offer_for(topic.offered_qos, _DEPTH)
    )
    own = [
        str(info.topic_type_hash)
        for info in node.get_publishers_info_by_topic(publisher.topic_name)
        if info.node_name == node.get_name()
    ]
    if topic.type_hash and own and topic.type_hash not in own:
        node.destroy_publisher(publisher)
        raise ConfigurationError(
            f'{topic.type} is defined in another way here than where it was recorded: '
            'install the version of its package that the bag was recorded with'
        )
    return publisher


def _chosen(bag: Bag, arguments: argparse.Namespace) -> list[Topic]:
    selection = Selection.of(
        arguments.topics,
        everything=not (arguments.topics or arguments.regex),
        regex=arguments.regex,
        exclude_regex=arguments.exclude_regex,
    )
    topics = bag.metadata.topics
    known = [topic.name for topic in topics]
    for name in selection.names:
        if name not in known:
            raise BagError(f'{bag.path}: has no topic {name}: it has {", ".join(sorted(known))}')
    return [topic for topic in topics if selection.wants(topic.name)]


def _positive(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f'{text} is no speed: give a number above 0')
    return value


def _seconds(text: str) -> float:
    value = float(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is no time: give seconds from the beginning')
    return value


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
