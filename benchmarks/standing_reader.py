"""Images that a reader aboard loses while the computer leaves it standing.

python benchmarks/standing_reader.py [--standing 1.7] [--depth 8] [--count 40] [--load 0]

Images of 2.8 MB go from one process to two others at 2 Hz, beside `--load` busy loops. The first
reader is stopped (SIGSTOP) three times for `--standing` seconds; `--depth` messages are kept for
it, by the writer and by itself. FASTRTPS_DEFAULT_PROFILES_FILE chooses another transport.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ftp_dent_ros.ros.qos import IMAGES
from ftp_dent_ros.supervision.transport import free_domain

_BYTES, _RATE = 2_764_800, 2.0  # 1280x720 of rgb8; photographs a second
_READERS = 2
_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def publish(count: int, depth: int) -> None:
    """So many images, as soon as all readers are there."""
    import rclpy
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import Image

    from ftp_dent_ros.ros.messages import ns_to_stamp, to_data

    rclpy.init()
    node = rclpy.create_node('camera')
    publisher = node.create_publisher(Image, 'image', QoSProfile(depth=depth))
    message = Image(height=720, width=1280, step=3840, encoding='rgb8')
    message.data = to_data(np.random.default_rng(0).integers(0, 256, _BYTES, dtype=np.uint8))
    while publisher.get_subscription_count() < _READERS:
        time.sleep(0.1)
    time.sleep(1.0)  # Until they know of it, too.
    for number in range(count):
        begin = time.time()
        message.header.frame_id, message.header.stamp = str(number), ns_to_stamp(time.time_ns())
        publisher.publish(message)
        time.sleep(max(0.0, begin + 1 / _RATE - time.time()))
    time.sleep(10.0)  # For what is on its way.


def listen(name: str, count: int, depth: int) -> None:
    """Say which did not come, and how late the others were."""
    import rclpy
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import Image

    from ftp_dent_ros.ros.messages import stamp_to_ns

    rclpy.init()
    node = rclpy.create_node(f'reader_{name}')
    late: dict[int, float] = {}

    def take(message: Image) -> None:
        late[int(message.header.frame_id)] = time.time() - stamp_to_ns(message.header.stamp) / 1e9

    node.create_subscription(Image, 'image', take, QoSProfile(depth=depth))
    end = time.monotonic() + count / _RATE + 60
    while count - 1 not in late and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.2)
    lost = sorted(set(range(count)) - set(late))
    median, most = np.median([*late.values()]), max(late.values())
    print(
        f'{name}: {len(late)} of {count} came, lost {lost}, {median:.3f} s late (median), '
        f'{most:.3f} at most'
    )


def run(arguments: argparse.Namespace) -> None:
    """All processes, and the stops."""
    words = [sys.executable, str(Path(__file__).resolve()), '--count', str(arguments.count)]
    words += ['--depth', str(arguments.depth), '--role']
    theirs = os.environ.get(_VARIABLE)
    with free_domain():
        if theirs:
            os.environ[_VARIABLE] = theirs
        loops = [multiprocessing.Process(target=_spin) for _ in range(arguments.load)]
        for loop in loops:
            loop.start()
        standing, *others = (
            subprocess.Popen([*words, role]) for role in ('stopped', 'beside', 'writer')
        )
        time.sleep(8.0)
        for _ in range(3):
            standing.send_signal(signal.SIGSTOP)
            time.sleep(arguments.standing)
            standing.send_signal(signal.SIGCONT)
            time.sleep(2.5)
        for process in (standing, *others):
            process.wait()
        for loop in loops:
            loop.kill()


def _spin() -> None:
    for _ in itertools.count():
        pass


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--standing', type=float, default=1.7, help='seconds')
    parser.add_argument('--depth', type=int, default=IMAGES.depth)
    parser.add_argument('--count', type=int, default=40)
    parser.add_argument('--load', type=int, default=0)
    parser.add_argument('--role', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role == 'writer':
        publish(arguments.count, arguments.depth)
    elif arguments.role:
        listen(arguments.role, arguments.count, arguments.depth)
    else:
        run(arguments)


if __name__ == '__main__':
    main()
