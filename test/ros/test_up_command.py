"""``ftp-dent up`` with real nodes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from ftp_dent_ros.pattern import Pattern, write_pattern


@pytest.fixture
def up(ros, tmp_path):
    """Function that starts the command on some nodes of the test's namespace."""
    write_pattern(tmp_path / 'pattern.yaml', Pattern(640, 400, 16.0, 320.0))
    started = []

    class Up:
        def __init__(self, **nodes):
            blocks = {
                f'{ros.namespace}/{name}': {'ros__parameters': parameters}
                for name, parameters in nodes.items()
            }
            configuration = tmp_path / 'payload.yaml'
            configuration.write_text(yaml.safe_dump(blocks))
            self._log = tmp_path / f'up{len(started)}.log'
            with self._log.open('w') as log:
                self.process = subprocess.Popen(
                    [sys.executable, '-m', 'ftp_dent_ros.cli.main', 'up', str(configuration)],
                    stdout=log,
                    stderr=subprocess.STDOUT,
                )
            started.append(self.process)

        @property
        def output(self):
            return self._log.read_text()

        def children(self):
            path = Path(f'/proc/{self.process.pid}/task/{self.process.pid}/children')
            return [int(word) for word in path.read_text().split()]

    Up.pattern = str(tmp_path / 'pattern.yaml')
    yield Up
    for process in started:
        process.kill()
        process.wait()


def ended(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] == 'Z'
    except FileNotFoundError:
        return True


def test_a_killed_node_comes_back_and_all_end_with_a_signal(ros, up):
    from sensor_msgs.msg import Image

    from ftp_dent_ros.ros.qos import LATCHED

    images = ros.collect(Image, 'projector/image_raw', LATCHED)
    payload = up(pattern_publisher={'pattern': up.pattern})
    ros.until(lambda: images)
    (node,) = payload.children()
    os.kill(node, signal.SIGKILL)
    ros.until(lambda: len(images) == 2)
    assert bytes(images[0].data) == bytes(images[1].data)
    name = f'{ros.namespace}/pattern_publisher'.strip('/')
    assert f'{name} was killed by SIGKILL: restarting it in 1 s' in payload.output
    (node,) = payload.children()
    payload.process.send_signal(signal.SIGINT)
    assert payload.process.wait(20.0) == 0
    assert ended(node)
    assert payload.output.rstrip().endswith('up | stopped')


def test_no_node_outlives_it(ros, up):
    payload = up(pattern_publisher={'pattern': up.pattern})
    ros.until(lambda: ros.node.count_publishers('projector/image_raw'))
    (node,) = payload.children()
    payload.process.kill()
    deadline = time.monotonic() + 20.0
    while not ended(node):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_wrong_parameters_are_said_and_not_tried_again(up):
    payload = up(pattern_publisher={'pattern': up.pattern, 'period_px': -3.0})
    assert payload.process.wait(20.0) == 2
    assert 'period_px' in payload.output
    assert 'ended with status 2: it cannot run with what it was given' in payload.output
    assert 'restarting' not in payload.output
