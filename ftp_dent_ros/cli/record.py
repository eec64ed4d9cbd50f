"""``ftp-dent record``: topics to an MCAP bag, as ``ros2 bag record`` does it.

A message is in the kernel's hands within milliseconds of its reception, so that a recorder that
is killed loses nothing that it has counted: ``ftp-dent recover`` gives it all back.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from ftp_dent_ros.errors import BagError, ConfigurationError
from ftp_dent_ros.recording.definitions import find_definition, type_hash
from ftp_dent_ros.recording.selection import Selection
from ftp_dent_ros.recording.spool import Spool
from ftp_dent_ros.recording.topic import Message, Topic
from ftp_dent_ros.recording.writer import BagWriter
from ftp_dent_ros.ros.bags import message_class, qos_from_profile, request_for
from ftp_dent_ros.ros.signals import stop_on_signal

_DISCOVERY_PERIOD_S = 0.1
_DEPTH = 100
_MEGABYTE = 10**6
_UNITS = {'': 1, 'K': 10**3, 'M': 10**6, 'G': 10**9}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('names', nargs='*', metavar='TOPIC', help='topics to record')
    parser.add_argument('--topics', nargs='+', default=[], metavar='TOPIC', help='more of them')
    parser.add_argument('-a', '--all', action='store_true', help='every topic, also later ones')
    parser.add_argument('-e', '--regex', default='', help='topics whose name matches')
    parser.add_argument(
        '-x', '--exclude-regex', default='', help='but not those of --all and --regex that match'
    )
    parser.add_argument(
        '-o', '--output', type=Path, help='folder of the bag: must not exist (default: by time)'
    )
    parser.add_argument(
        '-b',
        '--max-bag-size',
        '--max-size',
        type=_size,
        default=0,
        metavar='BYTES',
        help='begin a new file after so many bytes, as in 500M or 4G (default: one file)',
    )
    parser.add_argument(
        '--max-cache-size',
        type=_size,
        default=512 * _MEGABYTE,
        metavar='BYTES',
        help='memory for messages that wait for the disk (default: 512M)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Record until SIGINT or SIGTERM, or until the disk is full."""
    selection = Selection.of(
        [*arguments.names, *arguments.topics],
        everything=arguments.all,
        regex=arguments.regex,
        exclude_regex=arguments.exclude_regex,
    )
    if not (selection.names or selection.everything or selection.regex):
        raise ConfigurationError('nothing to record: name topics, or give --all or --regex')
    output = arguments.output or Path(time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S'))
    with stop_on_signal() as stop:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = Node('recorder', enable_rosout=False, start_parameter_services=False)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            writer = BagWriter(output, max_file_size=arguments.max_bag_size)
            spool = Spool(writer, arguments.max_cache_size)
            recorder = Recorder(node, writer.add_topic, spool.put, selection)
            progress = _Progress(writer)
            while not stop.is_set() and spool.error is None:
                executor.spin_once(timeout_sec=_DISCOVERY_PERIOD_S)
                progress.show()
            _take_the_rest(executor, recorder)
        finally:
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()
        spool.close()
        return _finish(writer, spool, recorder, progress)


class Recorder:
    """Subscribes to the topics wanted as they appear, and hands on what comes.

    Parameters
    ----------
    node : Node
        Spun by the caller.
    add_topic : callable
        Takes each topic before its first message.
    put : callable
        Takes each message.
    selection : Selection
        The topics wanted.

    Attributes
    ----------
    received, lost : int
        Messages that came, and those that the transport is known to have lost.
    """

    def __init__(
        self,
        node: Node,
        add_topic: Callable[[Topic], None],
        put: Callable[[Message], bool],
        selection: Selection,
    ) -> None:
        self.received = 0
        self.lost = 0
        self._node = node
        self._add_topic = add_topic
        self._put = put
        self._selection = selection
        self._subscriptions: dict[str, Subscription] = {}
        self._refused: set[str] = set()
        node.create_timer(_DISCOVERY_PERIOD_S, self.discover)
        self.discover()

    def discover(self) -> None:
        """Subscribe to new topics, and anew where a new publisher would not be heard."""
        for name, types in self._node.get_topic_names_and_types():
            if name in self._refused or not self._selection.wants(name):
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            if not publishers:
                continue
            if len(types) > 1:
                self._refuse(name, f'{name}: has several types ({", ".join(types)})')
                continue
            request = request_for([each.qos_profile for each in publishers], _DEPTH)
            subscription = self._subscriptions.get(name)
            if subscription is None:
                hash_ = str(publishers[0].topic_type_hash)
                hash_ = hash_ if hash_.startswith('RIHS') else type_hash(types[0])
                topic = Topic(
                    name=name,
                    type=types[0],
                    type_hash=hash_,
                    offered_qos=tuple(qos_from_profile(each.qos_profile) for each in publishers),
                    definition=find_definition(types[0], hash_),
                )
                self._subscribe(topic, request)
            elif _weaker(request, subscription.qos_profile):
                _say(f'{name}: a publisher offers less than the others: recording what all offer')
                del self._subscriptions[name]
                self._node.destroy_subscription(subscription)
                self._subscribe(Topic(name, types[0]), request)

    def _subscribe(self, topic: Topic, request: QoSProfile) -> None:
        try:
            kind = message_class(topic.type)
        except ConfigurationError as error:
            self._refuse(topic.name, f'{topic.name}: not recorded: {error}')
            return
        self._add_topic(topic)

        def take(data: bytes, info: dict[str, int | None]) -> None:
            self.received += 1
            received = info['received_timestamp'] or time.time_ns()
            self._put(
                Message(
                    topic.name,
                    topic.type,
                    received,
                    info['source_timestamp'] or received,
                    data,
                    (info['publication_sequence_number'] or 0) & 0xFFFFFFFF,
                )
            )

        def lose(event: object) -> None:
            self.lost += event.total_count_change  # type: ignore[attr-defined]

        self._subscriptions[topic.name] = self._node.create_subscription(
            kind,
            topic.name,
            take,
            request,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=lose),
        )
        _say(f'recording {topic.name} [{topic.type}]')

    def _refuse(self, name: str, why: str) -> None:
        self._refused.add(name)
        _say(why)


class _Progress:
    """What is written so far: in place on a terminal, now and then elsewhere."""

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self._in_place = sys.stderr.isatty()
        self._period = 0.5 if self._in_place else 5.0
        self._start = self._shown = time.monotonic()
        self._shown_size = 0

    def show(self) -> None:
        """Print a line if it is time for one."""
        now = time.monotonic()
        if now - self._shown < self._period:
            return
        rate = (self._writer.size - self._shown_size) / (now - self._shown)
        text = f'{self.total()}, {rate / _MEGABYTE:.1f} MB/s'
        print(text, end='\r' if self._in_place else '\n', file=sys.stderr, flush=True)
        self._shown, self._shown_size = now, self._writer.size

    def total(self) -> str:
        """Messages, megabytes and seconds so far."""
        return (
            f'{self._writer.message_count} messages, {self._writer.size / _MEGABYTE:.1f} MB '
            f'in {time.monotonic() - self._start:.1f} s'
        )


def _take_the_rest(executor: SingleThreadedExecutor, recorder: Recorder) -> None:
    """Take what had arrived when the signal came."""
    end = time.monotonic() + 1.0
    before = -1
    while recorder.received != before and time.monotonic() < end:
        before = recorder.received
        # One turn may go to a timer.
        for _ in range(5):
            executor.spin_once(timeout_sec=0.0)


def _finish(writer: BagWriter, spool: Spool, recorder: Recorder, progress: _Progress) -> int:
    lost = spool.dropped + recorder.lost
    if lost:
        _say(
            f'{recorder.lost} messages were lost on the way here and {spool.dropped} dropped '
            'because the disk was too slow or full: record fewer topics, or to a faster disk'
        )
    try:
        writer.close()
    except BagError as error:
        raise BagError(
            f'{spool.error or error}; the recording ends after {progress.total()}, and is made '
            f'whole by `ftp-dent recover {writer.folder} --output NEW` on a disk with room'
        ) from None
    if spool.error is not None:
        raise BagError(
            f'{spool.error}; the recording ends after {progress.total()}, which are a whole bag'
        )
    print(f'{writer.folder}: {progress.total()} of {len(writer.topics)} topics')
    return 0


def _weaker(request: QoSProfile, current: QoSProfile) -> bool:
    """Whether a subscription with `current` would not hear a publisher that `request` hears."""
    return (
        request.reliability == ReliabilityPolicy.BEST_EFFORT != current.reliability
        or request.durability == DurabilityPolicy.VOLATILE != current.durability
    )


def _size(text: str) -> int:
    match = re.fullmatch(r'(\d+)([KMG]?)B?', text.upper())
    if not match:
        raise argparse.ArgumentTypeError(f'{text!r} is no size: write it as 500000, 500M or 4G')
    return int(match.group(1)) * _UNITS[match.group(2)]


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
