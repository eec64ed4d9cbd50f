"""``ftp-dent up`` with real nodes."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
import yaml

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.ros.presence import alive, refuse_second
from ftp_dent_ros.supervision.shared_memory import free_leftovers


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
    assert f'{name} was killed by SIGKILL: restarting it' in payload.output
    (node,) = payload.children()
    payload.process.send_signal(signal.SIGINT)
    assert payload.process.wait(60) == 0
    assert ended(node)
    assert payload.output.rstrip().endswith('up | stopped')


def test_a_second_of_the_same_names_is_refused(ros, up):
    first = up(pattern_publisher={'pattern': up.pattern})
    state = ros.diagnostics('pattern_publisher')
    ros.until(state)
    second = up(pattern_publisher={'pattern': up.pattern})
    assert second.process.wait(60) == 2
    assert 'pattern_publisher is run by another payload in the ROS domain' in second.output
    assert first.process.poll() is None


def test_names_that_a_node_of_other_making_has_are_refused(ros, up):
    ros.start('pattern_publisher', pattern=up.pattern)
    name = f'{ros.namespace}/pattern_publisher'.strip('/')
    # As often as a busy machine needs to find it.
    assert ros.until(lambda: alive([name, 'another'])) == {name}
    with pytest.raises(ConfigurationError, match='runs already in this domain: end it'):
        for _ in range(10):
            refuse_second([name])


def test_what_killed_processes_have_left_is_given_back(ros, up):
    node = ros.start('pattern_publisher', pattern=up.pattern)
    ros.until(ros.diagnostics('pattern_publisher'))
    (segment,) = segments_of(node.pid)
    lock = Path(f'{segment}_el')
    assert segment.stat().st_size > 1 << 20
    os.utime(lock, (0, 0))
    node.kill()
    # Whoever of this machine does it first, and who is at it keeps others out.
    ros.until(lambda: free_leftovers() and not (segment.exists() or lock.exists()))


def segments_of(pid):
    """Segments of shared memory that a process has locked as its own."""
    locked = {
        int(words[5].rpartition(':')[2])
        for words in map(str.split, Path('/proc/locks').read_text().splitlines())
        if words[4] == str(pid)
    }
    segments = set()
    for path in Path('/dev/shm').glob('fastrtps_*_el'):
        with suppress(FileNotFoundError):  # another run's that has ended
            if 'port' not in path.name and path.stat().st_ino in locked:
                segments.add(path.with_name(path.name.removesuffix('_el')))
    return segments


def test_no_node_outlives_it(ros, up):
    payload = up(pattern_publisher={'pattern': up.pattern})
    ros.until(lambda: ros.node.count_publishers('projector/image_raw'))
    (node,) = payload.children()
    payload.process.kill()
    deadline = time.monotonic() + 60.0
    while not ended(node):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_wrong_parameters_are_said_and_not_tried_again(up):
    # Only the node itself finds that it does not fit the pattern.
    payload = up(pattern_publisher={'pattern': up.pattern, 'period_px': 300.0})
    assert payload.process.wait(60) == 2
    assert 'period_px is 300' in payload.output
    assert 'ended with status 2: it cannot run with what it was given' in payload.output
    assert 'restarting' not in payload.output


def test_wrong_names_start_nothing(up):
    payload = up(pattern_publisher={'pattern': up.pattern}, reconstruction={'strid': 2})
    assert payload.process.wait(60) == 2
    (line,) = payload.output.splitlines()
    assert line.endswith('there is no parameter strid: did you mean stride?')


@pytest.mark.parametrize('given', ['rigg:=a.yaml', 'strid:=2', 'displayy.enabled:=true'])
def test_a_node_by_itself_refuses_wrong_names_too(ros, given):
    process = ros.start('reconstruction', '-p', given)
    assert process.wait() == 2
    assert process.said[0].startswith('reconstruction: there is no parameter')
