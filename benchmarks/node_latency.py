"""Time from the publication of an image to the arrival of its cloud, between two processes.

python benchmarks/node_latency.py [--rate 20] [--seconds 60] [--size 1280x720] [--stride 2]

Over the transport that `ftp-dent up` selects.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig import Lens, Rig, write_rig
from ftp_dent_ros.ros.messages import image_to_message, stamp_to_ns
from ftp_dent_ros.ros.qos import CLOUDS, IMAGES, PATTERNS
from ftp_dent_ros.simulation import Panel, Renderer, Surface
from ftp_dent_ros.supervision.domain import free_domain

# Stamp of the first image: long after the pattern's.
_SETTLED_NS = 1_000_000_000


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
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split('x'))
    images = round(arguments.rate * arguments.seconds)
    rig, pattern = make_rig(width, height), Pattern(width, height, width / 70, width / 2)
    skin = Surface((Panel(Pose.from_rpy([0, 0.1, 0], [0, 0, 0.65]), (-1, 1, -1, 1), 2.0),))
    image = Renderer(rig, pattern.draw()).render(skin)

    with tempfile.TemporaryDirectory() as folder, free_domain(2):
        rig_file = Path(folder) / 'rig.yaml'
        write_rig(rig_file, rig)
        words = ['-p', f'rig:={rig_file}', '-p', f'stride:={arguments.stride}']
        module = 'ftp_dent_ros.nodes.reconstruction'
        process = subprocess.Popen([sys.executable, '-m', module, '--ros-args', *words])
        try:
            latencies = measure(image, pattern, images, arguments.rate)
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
        f'{arguments.size}, stride {arguments.stride}, {arguments.rate:g} a second: '
        f'{images - len(latencies)} of {images} lost'
    )
    for name, values in (('image to cloud', latencies), ('reconstruct() alone', durations)):
        print(
            f'{name}: median {1e3 * np.median(values):.0f} ms, '
            f'95 % below {1e3 * np.percentile(values, 95):.0f}, most {1e3 * max(values):.0f}'
        )


def measure(image: np.ndarray, pattern: Pattern, images: int, rate: float) -> list[float]:
    """Seconds from the publication of each image to the arrival of its cloud."""
    rclpy.init()
    node = rclpy.create_node('bench')
    arrivals: dict[int, float] = {}
    sent: dict[int, float] = {}

    def on_cloud(message: PointCloud2) -> None:
        arrivals[stamp_to_ns(message.header.stamp)] = time.perf_counter()

    node.create_subscription(PointCloud2, 'points', on_cloud, CLOUDS)
    projector = node.create_publisher(Image, 'projector/image_raw', PATTERNS)
    projector.publish(image_to_message(pattern.draw(), 1, ''))
    camera = node.create_publisher(Image, 'camera/image_raw', IMAGES)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)

    def spin(until: float) -> None:
        while time.perf_counter() < until:
            executor.spin_once(timeout_sec=max(0.0, until - time.perf_counter()))

    while not (camera.get_subscription_count() and node.count_publishers('points')):
        spin(time.perf_counter() + 0.1)
    spin(time.perf_counter() + 1.0)
    for number in range(images + 1):
        start = time.perf_counter()
        stamp_ns = _SETTLED_NS + number
        camera.publish(image_to_message(image, stamp_ns, 'camera'))
        sent[stamp_ns] = start
        # The first one builds the tables.
        spin(start + (1 / rate if number else 3.0))
    spin(time.perf_counter() + 1.0)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    return [arrivals[stamp] - sent[stamp] for stamp in arrivals if stamp > _SETTLED_NS]


if __name__ == '__main__':
    main()
