"""What the recorder takes without loss, and what is left of a recording that is killed.

Publishers and recorder are processes of their own, as in a flight.
"""

import argparse
import array
import importlib.util
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

# Topic: kind, bytes of a message, messages a second.
USUAL = ('/image:Image:2764800:20', '/points:PointCloud2:3686400:10', '/pose:PoseStamped:0:50')
HEAVY = ('/image:Image:2764800:20', '/points:PointCloud2:14745600:10', '/pose:PoseStamped:0:50')
SMALL = tuple(f'/pose{number}:PoseStamped:0:50' for number in range(8))
MEGABYTE = 10**6


def publish(seconds: float, specifications: list[str]) -> None:
    """Publish numbered messages at their rates, and print how many of each."""
    import rclpy
    from geometry_msgs.msg import PoseStamped
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import Image, PointCloud2

    kinds = {'Image': Image, 'PointCloud2': PointCloud2, 'PoseStamped': PoseStamped}
    rclpy.init()
    node = rclpy.create_node('publishers')
    streams = []
    for specification in specifications:
        topic, kind, size, rate = specification.split(':')
        message = kinds[kind]()
        if int(size):
            message.data = array.array('B', os.urandom(int(size)))
        publisher = node.create_publisher(kinds[kind], topic, QoSProfile(depth=10))
        streams.append([publisher, message, float(rate), 0])
    while not all(publisher.get_subscription_count() for publisher, *_ in streams):
        time.sleep(0.02)
    time.sleep(0.5)
    start = time.monotonic()
    while (now := time.monotonic() - start) < seconds:
        for stream in streams:
            publisher, message, rate, number = stream
            if now * rate >= number:
                message.header.stamp.sec = number
                publisher.publish(message)
                stream[3] += 1
        time.sleep(0.001)
    for publisher, _, _, number in streams:
        publisher.wait_for_all_acked()
        print(publisher.topic_name, number)
    rclpy.shutdown()


def run(name: str, specifications: tuple[str, ...], seconds: float, kill: bool) -> None:
    """Record the publishers, and compare the bag with what they sent."""
    from ftp_dent_ros.recording.reader import open_bag
    from ftp_dent_ros.recording.recovery import recover
    from ftp_dent_ros.supervision import transport

    folder = Path(tempfile.mkdtemp(prefix='ftp_dent_ros.'))
    bag = folder / 'bag'
    with transport.profile() as variables:
        environment = {**os.environ, **variables}
        record = [sys.executable, '-m', 'ftp_dent_ros.cli.main', 'record', '--all']
        recorder = subprocess.Popen(
            [*record, '--exclude-regex', 'rosout|events', '-o', str(bag)],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        publisher = subprocess.Popen(
            [sys.executable, __file__, '--publish', str(seconds), *specifications],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        memory = []
        while publisher.poll() is None:
            time.sleep(min(1.0, seconds / 10))
            memory.append(resident(recorder.pid))
        output, _ = publisher.communicate()
        recorder.send_signal(signal.SIGKILL if kill else signal.SIGINT)
        recorder.wait()
    size = (bag / 'bag_0.mcap').stat().st_size
    if kill:
        recover(bag, folder / 'new')
        bag = folder / 'new'
    numbers = defaultdict(list)
    for message in open_bag(bag).messages():
        # In serialised messages with a header its stamp's seconds stand at offset 4.
        numbers[message.topic].append(struct.unpack_from('<i', message.data, 4)[0])
    count = sum(map(len, numbers.values()))
    print(f'{name}: {size / MEGABYTE:.0f} MB, {size / MEGABYTE / seconds:.0f} MB/s')
    print(f'  {count} messages in {chunks(next(bag.glob("*.mcap")))} chunks')
    settled = memory[len(memory) // 2 :]
    if seconds >= 30:
        growth = (settled[-1] - settled[0]) / len(settled) * 60
        print(f'  memory: {settled[-1] / MEGABYTE:.0f} MB, {growth / MEGABYTE:+.2f} MB a minute')
    for topic, sent in (line.split() for line in output.splitlines()):
        missing = int(sent) - len(set(numbers[topic]))
        print(f'  {topic:10s} {sent:>5s} sent, {missing} lost')
    shutil.rmtree(folder)


def resident(pid: int) -> int:
    """Bytes of memory that a process holds."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE')


def chunks(path: Path) -> int:
    """How many chunks a file has."""
    from mcap.reader import SeekingReader

    with path.open('rb') as stream:
        return len(SeekingReader(stream).get_summary().chunk_indexes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=5.0)
    parser.add_argument('--publish', nargs='+', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if any(importlib.util.find_spec(name) is None for name in ('rclpy', 'mcap', 'rosbags')):
        print('rclpy, mcap or rosbags is not installed: nothing is measured')
        return
    os.environ.setdefault('ROS_DOMAIN_ID', '97')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    if arguments.publish:
        publish(float(arguments.publish[0]), arguments.publish[1:])
        return
    run('images, clouds of every second pixel, poses', USUAL, arguments.seconds, kill=False)
    run('images, clouds of every pixel, poses', HEAVY, arguments.seconds, kill=False)
    run('recorder killed with -9, bag recovered', USUAL, arguments.seconds, kill=True)
    run('small messages', SMALL, max(60.0, arguments.seconds), kill=False)


if __name__ == '__main__':
    main()
