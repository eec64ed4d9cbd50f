"""``ftp-dent replay``: publishes the messages of a bag, byte for byte, at their original times."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number
from ftp_dent_ros.errors import BagError
from ftp_dent_ros.recording.reader import Bag, open_bag
from ftp_dent_ros.recording.ros.player import Player
from ftp_dent_ros.recording.topic import RecordedTopic, absolute_names
from ftp_dent_ros.ros.session import session

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
