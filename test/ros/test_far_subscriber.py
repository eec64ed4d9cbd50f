"""A plain subscriber elsewhere gets tagged clouds in parts that a lossy network carries."""

import os
import subprocess
import sys

import numpy as np
import pytest
import rclpy
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ros.messages import to_data
from ftp_dent_ros.ros.qos import CLOUDS
from ftp_dent_ros.supervision.transport import profile

SIZE, MOST_PACKETS = 1_000_000, 6


def publish(topic):
    rclpy.init()
    node = rclpy.create_node('payload')
    publisher = node.create_publisher(PointCloud2, topic, CLOUDS)
    message = PointCloud2(height=1, width=SIZE // 16, point_step=16, row_step=SIZE)
    message.data = to_data(np.zeros(SIZE, np.uint8))
    node.create_timer(0.2, lambda: publisher.publish(message))
    rclpy.spin(node)


def listen(topic):
    rclpy.init()
    node = rclpy.create_node('ground')
    came = []
    node.create_subscription(PointCloud2, topic, came.append, CLOUDS)
    while not came:
        rclpy.spin_once(node, timeout_sec=0.5)
    assert len(came[0].data) == SIZE


@pytest.mark.parametrize(('topic', 'is_small'), [('tagged/points', True), ('points', False)])
def test_parts_of_tagged_clouds_are_of_few_packets(topic, is_small):
    # Not for this file's own processes, which know of no benchmark.
    from simulated_radio import Conditions, joined_sites

    environment = dict(os.environ, ROS_DOMAIN_ID='1')
    environment.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)
    environment.pop('FASTRTPS_DEFAULT_PROFILES_FILE', None)
    try:
        with joined_sites(Conditions()) as joined, profile(environment=environment) as chosen:
            environment.update(chosen)

            def start(site, role):
                words = [sys.executable, __file__, role, topic]
                return subprocess.Popen(site.command(words), env=environment)

            payload, ground = start(joined.drone, 'publish'), start(joined.ground, 'listen')
            try:
                assert ground.wait(60) == 0
            finally:
                for process in (payload, ground):
                    process.kill()
                    process.wait()
            words = joined.ground.command(['cat', '/proc/net/snmp'])
            text = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    except ConfigurationError as reason:
        pytest.skip(f'{reason}: a subscriber on another computer is not tested')
    names, values = (line.split() for line in text.splitlines() if line.startswith('Ip:'))
    counts = dict(zip(names, values, strict=True))
    packets = int(counts['ReasmReqds']) / int(counts['ReasmOKs'])
    assert (packets <= MOST_PACKETS) == is_small


if __name__ == '__main__':
    {'publish': publish, 'listen': listen}[sys.argv[1]](sys.argv[2])
