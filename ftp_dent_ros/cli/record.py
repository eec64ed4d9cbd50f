"""``ftp-dent record``: topics to an MCAP bag, as ``ros2 bag record`` does it.

A message is in the kernel's hands as soon as the writer's thread gets to it, and only then is it
counted: a recorder that is killed loses nothing that it has counted, and ``ftp-dent recover``
gives it all back. A power cut costs the last two seconds.
"""

from __future__ import annotations

import argparse
import threading
import time
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ftp_dent_ros.cli import argument
from ftp_dent_ros.coding.messages import message_class
from ftp_dent_ros.errors import BagError, ConfigurationError
from ftp_dent_ros.recording.clouds import RIG, rig_id_in
from ftp_dent_ros.recording.ros import say
from ftp_dent_ros.recording.ros.recorder import DISCOVERY_PERIOD_S, Recorder
from ftp_dent_ros.recording.topic import absolute_names
from ftp_dent_ros.recording.writer import BagSpool, BagWriter
from ftp_dent_ros.ros.qos import DIAGNOSTICS
from ftp_dent_ros.ros.session import session

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
        recorder = Recorder(node, writer.add_topic, spool.put, names, arguments.all)
        _note_rig(node, writer)
        failure: Exception | None = None
        start = time.monotonic()
        try:
            _receive(node, recorder, spool, writer, stop)
        finally:
            spool.close()
            try:
                writer.close()
            except BagError as error:
                failure = error
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
    if spool.error is not None and not isinstance(spool.error, BagError):
        raise spool.error
    if failure is not None:
        raise BagError(
            f'{failure}; the recording ends after {total}: '
            f'make it whole with `ftp-dent recover {output} --output NEW` on a disk with room'
        )
    print(f'{output}: {total}, {len(writer.topics)} topics')
    return 0


def _writer(arguments: argparse.Namespace, output: Path) -> BagWriter:
    if not arguments.compress:
        return BagWriter(output)
    from ftp_dent_ros.recording.compression import CompressedBagWriter

    return CompressedBagWriter(output)


def _note_rig(node: Node, writer: BagWriter) -> None:
    """Have the bag say which rig measures: the latest in the diagnostics."""

    def on_array(array: Any) -> None:
        rig_id = rig_id_in(array)
        if rig_id:
            writer.custom_data[RIG] = rig_id

    array_type = message_class('diagnostic_msgs/msg/DiagnosticArray')
    node.create_subscription(array_type, '/diagnostics', on_array, DIAGNOSTICS)


def _receive(
    node: Node, recorder: Recorder, spool: BagSpool, writer: BagWriter, stop: threading.Event
) -> None:
    """Take what comes until it is enough, and say every five seconds how much that is."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    shown = time.monotonic()
    try:
        while not (stop.is_set() or spool.error):
            executor.spin_once(timeout_sec=DISCOVERY_PERIOD_S)
            if time.monotonic() - shown > 5.0:
                shown = time.monotonic()
                say(f'{writer.message_count} messages, {writer.size / 1e6:.1f} MB')
        # What had arrived when the signal came is taken too.
        end = time.monotonic() + 1.0
        before = -1
        while recorder.received != before and time.monotonic() < end:
            before = recorder.received
            for _ in range(5):  # some turns go to timers and events
                executor.spin_once(timeout_sec=0.0)
    finally:
        executor.shutdown()
