"""``ftp-dent replay``: publishes the messages of a bag, byte for byte, at their original times."""

from __future__ import annotations

import argparse
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from tqdm import tqdm

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.recording.topic import Message, Qos, RecordedTopic, absolute_names
from ftp_dent_ros.ros.qos import quality
from ftp_dent_ros.ros.session import say, session

ARGUMENTS = (
    argument('bag', type=Path, help='folder of the bag, or an .mcap file'),
    argument(
        '-r',
        '--rate',
        type=number('--rate', 0.001),
        default=1.0,
        help='times the original speed; inf: at once',
    ),
    argument('--topics', nargs='+', default=[], metavar='TOPIC', help='only these (default: all)'),
    argument(
        '--start-offset',
        type=number('--start-offset', 0, 1e9),
        default=0.0,
        metavar='SECONDS',
        help='begin so far into the bag; latched messages from before are published first',
    ),
    argument(
        '-m',
        '--remap',
        nargs='+',
        default=[],
        metavar='OLD:=NEW',
        help='publish under other names',
    ),
    argument(
        '--wait-for-subscribers',
        action='store_true',
        help='begin when every topic has a subscriber',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Replay until the end, or until SIGINT or SIGTERM."""
    bag = open_bag(arguments.bag)
    topics = _chosen(bag, arguments)
    remaps = [word for rule in arguments.remap for word in ('-r', rule)]
    with session('player', remaps) as (node, stop):
        player = Player(node, bag, topics, stop)
        player.wait_for_subscribers(all_of_them=arguments.wait_for_subscribers)
        start = time.monotonic()
        player.play(arguments.rate, round(arguments.start_offset * 1e9))
        player.wait_for_acknowledgements()
    print(
        f'{arguments.bag}: {player.published} messages of {len(player.topics)} topics '
        f'in {time.monotonic() - start:.1f} s'
    )
    return 0


def _chosen(bag: Bag, arguments: argparse.Namespace) -> list[RecordedTopic]:
    known = {topic.name: topic for topic in bag.metadata.topics}
    names = absolute_names(arguments.topics) or tuple(known)
    for name in names:
        if name not in known:
            raise BagError(f'{bag.path}: has no topic {name}: it has {", ".join(sorted(known))}')
    return [topic for topic in bag.metadata.topics if topic.name in names]


# Of each topic: long enough not to wait for each message, short enough for large ones.
_DEPTH = 10


class Player:
    """Publishes a bag's messages, as reliable and as latched as they were recorded.

    Reliable subscriptions get every message, whatever the rate.

    Parameters
    ----------
    node : Node
        Need not be spun.
    bag : Bag
        What to play.
    topics : sequence of RecordedTopic
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

    def __init__(
        self, node: Node, bag: Bag, topics: Sequence[RecordedTopic], stop: threading.Event
    ) -> None:
        self.published = 0
        self._bag = bag
        self._stop = stop
        self._publishers: dict[str, Publisher] = {}
        self._types: dict[str, str] = {}
        self._unacknowledged: Counter[str] = Counter()
        for topic in topics:
            if topic.name in self._publishers:
                first = self._types[topic.name]
                say(f'{topic.name}: its {topic.type} are not replayed: only its {first}')
                continue
            try:
                self._publishers[topic.name] = node.create_publisher(
                    message_class(topic.type), topic.name, offer_for(topic.offered_qos)
                )
                self._types[topic.name] = topic.type
            except Exception as reason:  # an unknown type, or a name that is not ROS's
                say(f'{topic.name}: not replayed: {str(reason).splitlines()[0].rstrip(":")}')
        if topics and not self._publishers:
            raise BagError(f'{bag.path}: none of its topics can be replayed here: see above')

    @property
    def topics(self) -> list[str]:
        """Names, in the bag, of the topics that are published."""
        return list(self._publishers)

    def wait_for_subscribers(self, all_of_them: bool) -> None:
        """Wait until discovery has been quiet for half a second, or every topic is subscribed."""
        counts: dict[str, int] = {}
        quiet_since = said = time.monotonic()
        while not self._stop.wait(0.02):
            now = time.monotonic()
            new = {name: each.get_subscription_count() for name, each in self._publishers.items()}
            if new != counts:
                counts, quiet_since = new, now
            missing = sorted(name for name, count in counts.items() if not count)
            if now - quiet_since >= 0.5 and not (all_of_them and missing):
                return
            if missing and all_of_them and now - said >= 2:
                say(f'waiting for subscribers of {", ".join(missing)}')
                said = now

    def play(self, rate: float, offset_ns: int) -> None:
        """Play from `offset_ns` into the bag."""
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
                ahead = due - time.monotonic()
                if self._stop.wait(min(max(0.0, ahead), threading.TIMEOUT_MAX)):
                    return
                if message.type == self._types[message.topic]:
                    self._publish(message, hurried=ahead < 0)
                bar.update()

    def wait_for_acknowledgements(self) -> None:
        """Wait until reliable subscriptions have everything, or have been silent for long."""
        for name in self._publishers:
            self._wait_for_acknowledgement(name)

    def _publish(self, message: Message, hurried: bool = False) -> None:
        name = message.topic
        self._publishers[name].publish(message.data)
        self.published += 1
        self._unacknowledged[name] += 1
        # At the original times the subscribers keep up, as they did then.
        if hurried and self._unacknowledged[name] >= _DEPTH:
            self._wait_for_acknowledgement(name)

    def _wait_for_acknowledgement(self, name: str) -> None:
        # Without the shipped transport.xml Fast DDS asks for acknowledgements every 3 s only.
        end = time.monotonic() + 10.0
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
        for message in self._bag.messages(latched):
            if message.log_time_ns >= start_ns:
                break
            if message.type == self._types[message.topic]:
                last[message.topic] = message
        yield from last.values()


def offer_for(recorded: Sequence[Qos]) -> QoSProfile:
    """What a publisher must offer in the place of those that were recorded.

    The most that one of them offered, so that every subscription that heard one hears this one.
    """
    reliable = not recorded or any(qos.reliability == 'reliable' for qos in recorded)
    latched = any(qos.durability == 'transient_local' for qos in recorded)
    return quality(reliable, latched, _DEPTH)
