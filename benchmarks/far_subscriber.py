"""Whether a plain subscriber on the ground delays what runs aboard: clouds over a slow interface.

python benchmarks/far_subscriber.py [--rate 20] [--seconds 8] [--megabytes 5.5]

The interface is a kernel's queue of that rate (Mbit/s), which makes a sender wait, before a
simulated radio without a limit. It takes root. FASTRTPS_DEFAULT_PROFILES_FILE chooses another
transport.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ftp_dent_ros.simulation.radio import Conditions, Site, joined_sites
from ftp_dent_ros.supervision.transport import profile


def publish(seconds: float, size: int) -> None:
    """Two clouds a second, as soon as both subscribers are there."""
    import rclpy
    from sensor_msgs.msg import PointCloud2

    from ftp_dent_ros.ros.messages import ns_to_stamp, to_data
    from ftp_dent_ros.ros.qos import CLOUDS

    rclpy.init()
    node = rclpy.create_node('payload')
    publisher = node.create_publisher(PointCloud2, 'tagged/points', CLOUDS)
    message = PointCloud2(height=1, width=size // 16, point_step=16, row_step=size)
    message.data = to_data(np.random.default_rng(0).integers(0, 256, size, dtype=np.uint8))
    while publisher.get_subscription_count() < 2:
        time.sleep(0.1)
    time.sleep(1.0)  # Until they know of it, too.
    took = []
    end = time.time() + seconds
    while time.time() < end:
        begin = time.time()
        message.header.stamp = ns_to_stamp(time.time_ns())
        publisher.publish(message)
        took.append(time.time() - begin)
        time.sleep(max(0.0, begin + 0.5 - time.time()))
    print(
        f'{len(took)} published in {seconds:g} s; publish() took {1e3 * np.median(took):.0f} ms '
        f'(median), {1e3 * max(took):.0f} at most',
        flush=True,
    )


def listen(where: str, seconds: float) -> None:
    """Say how many came, and how late."""
    import rclpy
    from sensor_msgs.msg import PointCloud2

    from ftp_dent_ros.ros.messages import stamp_to_ns
    from ftp_dent_ros.ros.qos import CLOUDS

    rclpy.init()
    node = rclpy.create_node(where)
    late: list[float] = []
    node.create_subscription(
        PointCloud2,
        'tagged/points',
        lambda message: late.append(time.time() - stamp_to_ns(message.header.stamp) / 1e9),
        CLOUDS,
    )
    while not node.count_publishers('tagged/points'):
        time.sleep(0.1)
    end = time.time() + seconds
    while time.time() < end:
        rclpy.spin_once(node, timeout_sec=0.2)
    text = f', {np.median(late):.3f} s late (median), {max(late):.3f} at most' if late else ''
    print(f'{where}: {len(late)} came{text}', flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rate', type=float, default=20.0)
    parser.add_argument('--loss', type=float, default=0.0, help='share of packets')
    parser.add_argument('--seconds', type=float, default=8.0)
    parser.add_argument('--megabytes', type=float, default=5.5)
    parser.add_argument('--role', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    size = round(arguments.megabytes * 1e6 / 16) * 16
    if arguments.role == 'payload':
        publish(arguments.seconds, size)
    elif arguments.role:
        listen(arguments.role, arguments.seconds + 8)
    else:
        run(arguments)


def run(arguments: argparse.Namespace) -> None:
    """Publisher and a subscriber aboard, another on the ground."""
    environment = {**os.environ, 'ROS_DOMAIN_ID': '1'}
    environment.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)
    words = [sys.executable, str(Path(__file__).resolve())]
    words += ['--seconds', str(arguments.seconds), '--megabytes', str(arguments.megabytes)]
    with (
        joined_sites(Conditions(delay=0.005, loss=arguments.loss)) as joined,
        profile() as transport,
    ):
        tbf = ('tc', 'qdisc', 'add', 'dev', joined.drone.interface, 'root', 'tbf')
        limits = ('rate', f'{arguments.rate:g}mbit', 'burst', '64kb', 'limit', '40mb')
        subprocess.run(joined.drone.command([*tbf, *limits]), check=True)
        processes = [
            subprocess.Popen(
                site.command([*words, '--role', role]), env={**environment, **transport}
            )
            for site, role in (
                (joined.ground, 'ground'),
                (joined.drone, 'aboard'),
                (joined.drone, 'payload'),
            )
        ]
        for process in processes:
            process.wait()
        for name, site in (('aboard', joined.drone), ('ground', joined.ground)):
            print(f'{name}: {_lost(site)}')


def _lost(site: Site) -> str:
    """What a site's kernel has thrown away."""
    text = subprocess.run(
        site.command(['cat', '/proc/net/snmp']), check=True, capture_output=True, text=True
    ).stdout
    rows = [line.split() for line in text.splitlines() if line.startswith(('Ip:', 'Udp:'))]
    numbers = dict(zip((*rows[0], *rows[2]), (*rows[1], *rows[3]), strict=True))
    return (
        f'{numbers["ReasmFails"]} datagrams not put together, {numbers["RcvbufErrors"]} did not '
        f'fit into a receiving socket, {numbers["SndbufErrors"]} not into a sending one'
    )


if __name__ == '__main__':
    main()
