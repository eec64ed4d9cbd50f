"""Time from the publication of an image to the arrival of its cloud, between two processes.

python benchmarks/node_latency.py [--rate 20] [--seconds 60] [--size 1280x720] [--stride 2]
                                  [--code contrast] [--dead-link]

Over the transport that `ftp-dent up` selects. With ``--dead-link`` every other ten seconds a
`downlink` runs that no ground ever reaches, and both halves are told, with what it takes of the
processor.
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2
from timing import processor_time

from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Lens, Rig, write_rig
from ftp_dent_ros.ros.messages import image_to_message, stamp_to_ns
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, PATTERNS
from ftp_dent_ros.simulation import Panel, Renderer, Surface
from ftp_dent_ros.supervision.transport import free_domain

# Stamp of the first image: long after the pattern's.
_SETTLED_NS = 1_000_000_000
# Seconds with, and as many without a dead link.
_TURN = 10.0


def make_rig(width: int, height: int) -> Rig:
    """Camera and projector of the same size, 0.2 m apart, both looking at what is 0.6 m away."""

    def lens(focal: float) -> Lens:
        matrix = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
        return Lens(width, height, np.array(matrix), np.zeros(5))

    turn = Rotation.from_euler('y', 0.3).as_matrix()
    return Rig(lens(1.3 * width), lens(1.34 * width), turn, np.array([-0.2, 0.0, 0.03]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rate', type=float, default=20.0)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--size', default='1280x720')
    parser.add_argument('--stride', type=int, default=2)
    parser.add_argument('--code', choices=CODES, default='stripe')
    parser.add_argument('--dead-link', action='store_true')
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split('x'))
    images = round(arguments.rate * arguments.seconds)
    rig = make_rig(width, height)
    pattern = Pattern(width, height, width / 70, width / 2, code=arguments.code)
    skin = Surface((Panel(Pose.from_rpy([0, 0.1, 0], [0, 0, 0.65]), (-1, 1, -1, 1), 2.0),))
    image = Renderer(rig, pattern.draw()).render(skin)

    with tempfile.TemporaryDirectory() as folder, free_domain():
        rig_file = Path(folder) / 'rig.yaml'
        write_rig(rig_file, rig)
        words = ['-p', f'rig:={rig_file}', '-p', f'stride:={arguments.stride}']
        process = start_node('reconstruction', words)
        try:
            bench = Bench(image, pattern)
            every = round(_TURN * arguments.rate) if arguments.dead_link else images
            latencies, beside = [], []
            used = processor_time(process.pid)
            for number, begin in enumerate(range(0, images, every)):
                count = min(every, images - begin)
                if number % 2:
                    with dead_link(bench, Path(folder)):
                        beside += bench.latencies(count, arguments.rate)
                else:
                    latencies += bench.latencies(count, arguments.rate)
            used = processor_time(process.pid) - used
            bench.close()
        finally:
            process.terminate()
            process.wait()

    reconstructor = Reconstructor(rig, pattern, Settings(stride=arguments.stride))
    durations = []
    for _ in range(10):
        start = time.perf_counter()
        reconstructor.reconstruct(image)
        durations.append(time.perf_counter() - start)
    print(
        f'{arguments.size}, {arguments.code}, stride {arguments.stride}, '
        f'{arguments.rate:g} a second: '
        f'{images - len(latencies) - len(beside)} of {images} lost; '
        f'{1e3 * used / max(len(latencies) + len(beside), 1):.0f} ms of the processor a cloud'
    )
    rows = [('image to cloud', latencies), ('reconstruct() alone', durations)]
    if beside:
        rows.insert(1, ('beside a dead link', beside))
    for name, values in rows:
        print(
            f'{name}: median {1e3 * np.median(values):.0f} ms, '
            f'95 % below {1e3 * np.percentile(values, 95):.0f}, most {1e3 * max(values):.0f}'
        )


class Bench:
    """Publishes images and waits for their clouds."""

    def __init__(self, image: np.ndarray, pattern: Pattern) -> None:
        rclpy.init()
        self.node = rclpy.create_node('bench')
        self._image, self._number = image, 0
        self._arrivals: dict[int, float] = {}
        self.node.create_subscription(PointCloud2, 'points', self._on_cloud, CLOUDS)
        projector = self.node.create_publisher(Image, 'projector/image_raw', PATTERNS)
        projector.publish(image_to_message(pattern.draw(), 1, ''))
        self._camera = self.node.create_publisher(Image, 'camera/image_raw', IMAGES)
        self._executor = rclpy.executors.SingleThreadedExecutor()
        self._executor.add_node(self.node)
        while not (self._camera.get_subscription_count() and self.node.count_publishers('points')):
            self.spin(0.1)
        self.spin(1.0)
        # The first one builds the tables.
        self.latencies(1, 1 / 3)

    def latencies(self, count: int, rate: float) -> list[float]:
        """Seconds from the publication of each image to the arrival of its cloud."""
        sent: dict[int, float] = {}
        for _ in range(count):
            self._number += 1
            stamp_ns, start = _SETTLED_NS + self._number, time.perf_counter()
            self._camera.publish(image_to_message(self._image, stamp_ns, 'camera'))
            sent[stamp_ns] = start
            self.spin(start + 1 / rate - time.perf_counter())
        self.spin(1.0)
        return [self._arrivals[stamp] - sent[stamp] for stamp in sent if stamp in self._arrivals]

    def spin(self, seconds: float) -> None:
        """Take what comes for so long."""
        until = time.perf_counter() + seconds
        while (left := until - time.perf_counter()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()

    def _on_cloud(self, message: PointCloud2) -> None:
        self._arrivals[stamp_to_ns(message.header.stamp)] = time.perf_counter()


def start_node(node: str, words: list[str]) -> subprocess.Popen[bytes]:
    """A node as a process, with what follows ``--ros-args``."""
    return subprocess.Popen(
        [sys.executable, '-m', 'ftp_dent_ros.nodes', node, '--ros-args', *words]
    )


@contextmanager
def dead_link(bench: Bench, folder: Path) -> Iterator[None]:
    """A downlink that keeps all on disk, for nobody ever connects to it."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    words = ['-p', f'address:=127.0.0.1:{port}', '-p', f'spool.folder:={folder}/spool']
    process = start_node('downlink', words)
    try:
        while bench.node.count_subscribers('points') < 2:
            bench.spin(0.1)
        bench.spin(1.0)
        start, used = time.monotonic(), processor_time(process.pid)
        yield
        share = (processor_time(process.pid) - used) / (time.monotonic() - start)
        print(f'downlink: {100 * share:.1f} % of a core')
    finally:
        process.terminate()
        process.wait()


if __name__ == '__main__':
    main()
