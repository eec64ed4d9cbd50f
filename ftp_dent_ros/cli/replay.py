"""``ftp-dent replay``: publishes the messages of a bag, byte for byte, at their original times."""

from __future__ import annotations

import argparse
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from tqdm import tqdm

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.recording.topic import Qos, RecordedTopic, absolute_names
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
    names = absolute_names(arguments.topics)
    topics = bag.topics_of(names) if names else bag.topics
    remaps = [word for rule in arguments.remap for word in ('-r', rule)]
    with session('player', remaps) as (node, stop):
        player = Player(node, bag, topics, stop)
        player.wait_for_subscribers(all_of_them=arguments.wait_for_subscribers)
        start = time.monotonic()
        player.play(arguments.rate)
    print(
        f'{arguments.bag}: {player.published} messages of {len(player.topics)} topics '
        f'in {time.monotonic() - start:.1f} s'
    )
    return 0


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
    published : int
        Messages so far.
    topics : set of str
        Names, in the bag, of the topics that are published.

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
        #: By the topic's name and type.
        self._publishers: dict[tuple[str, str], Publisher] = {}
        self._unacknowledged: Counter[Publisher] = Counter()
        for topic in topics:
            try:
                self._publishers[topic.name, topic.type] = node.create_publisher(
                    message_class(topic.type), topic.name, offer_for(topic.offered_qos)
                )
            except Exception as reason:  # noqa: PERF203  # of a type or name that cannot be
                say(f'{topic.name}: not replayed: {str(reason).splitlines()[0].rstrip(":")}')
        self.topics = {name for name, _ in self._publishers}
        if topics and not self._publishers:
            raise BagError(f'{bag.path}: none of its topics can be replayed here: see above')

    def wait_for_subscribers(self, all_of_them: bool) -> None:
        """Wait until discovery has been quiet for half a second, or every topic is subscribed."""
        counts: dict[str, int] = {}
        quiet_since = said = time.monotonic()
        while not self._stop.wait(0.02):
            now = time.monotonic()
            new = {
                name: each.get_subscription_count() for (name, _), each in self._publishers.items()
            }
            if new != counts:
                counts, quiet_since = new, now
            missing = sorted(name for name, count in counts.items() if not count)
            if now - quiet_since >= 0.5 and not (all_of_them and missing):
                return
            if missing and all_of_them and now - said >= 2:
                say(f'waiting for subscribers of {", ".join(missing)}')
                said = now

    def play(self, rate: float) -> None:
        """Play the bag at so many times its speed, until reliable subscriptions have all of it."""
        total = sum(self._bag.message_counts[name] for name in self.topics)
        start = time.monotonic()
        with tqdm(total=total, unit=' messages', disable=None) as bar:
            for message in self._bag.messages(self.topics):
                due = start + (message.log_time_ns - self._bag.start_ns) / 1e9 / rate
                # The event is looked at also where nothing is to be waited for.
                ahead = due - time.monotonic()
                if self._stop.wait(min(max(0.0, ahead), threading.TIMEOUT_MAX)):
                    return
                publisher = self._publishers.get((message.topic, message.type))
                bar.update()
                if publisher is None:
                    continue
                publisher.publish(message.data)
                self.published += 1
                self._unacknowledged[publisher] += 1
                # At the original times the subscribers keep up, as they did then.
                if ahead < 0 and self._unacknowledged[publisher] >= _DEPTH:
                    self._wait_for_acknowledgement(publisher)
        for publisher in self._publishers.values():
            self._wait_for_acknowledgement(publisher)

    def _wait_for_acknowledgement(self, publisher: Publisher) -> None:
        """Wait until reliable subscriptions have everything, or have been silent for long."""
        # Without the shipped transport.xml Fast DDS asks for acknowledgements every 3 s only.
        end = time.monotonic() + 10.0
        while not publisher.wait_for_all_acked(Duration(nanoseconds=50_000_000)):
            if self._stop.is_set() or time.monotonic() > end:
                return
        self._unacknowledged[publisher] = 0


def offer_for(recorded: Sequence[Qos]) -> QoSProfile:
    """What a publisher must offer in the place of those that were recorded.

    The most that one of them offered, so that every subscription that heard one hears this one.
    """
    reliable = not recorded or any(qos.reliability == 'reliable' for qos in recorded)
    latched = any(qos.durability == 'transient_local' for qos in recorded)
    return quality(reliable, latched, _DEPTH)
