"""``ftp-dent up`` with real nodes."""

import os
import signal
from pathlib import Path

import pytest
import yaml
from sensor_msgs.msg import Image

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.nodes.settings import fitted
from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.ros.qos import LATCHED
from ftp_dent_ros.ros.session import check_parameters, refuse_second
from ftp_dent_ros.supervision.configuration import read_configuration


@pytest.fixture
def pattern(tmp_path):
    write_pattern(tmp_path / 'pattern.yaml', Pattern(640, 400, 16.0, 320.0))
    return str(tmp_path / 'pattern.yaml')


@pytest.fixture
def up(ros, tmp_path):
    """Function that starts the command on some nodes of the test's namespace."""

    def start(**nodes):
        blocks = {
            f'{ros.namespace}/{name}': {'ros__parameters': parameters}
            for name, parameters in nodes.items()
        }
        configuration = tmp_path / 'payload.yaml'
        configuration.write_text(yaml.safe_dump(blocks))
        return ros.command('up', configuration)

    return start


def children(process):
    path = Path(f'/proc/{process.pid}/task/{process.pid}/children')
    return [int(word) for word in path.read_text().split()]


def ended(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] == 'Z'
    except FileNotFoundError:
        return True


def test_a_killed_node_comes_back_as_it_was_and_all_end_with_a_signal(ros, up, pattern, tmp_path):
    images = ros.collect(Image, 'projector/image_raw', LATCHED)
    rig = tmp_path / 'rig.yaml'
    rig.write_bytes(find('shipped:rig.yaml').read_bytes())
    payload = up(pattern_publisher={'pattern': pattern}, reconstruction={'rig': str(rig)})
    state = ros.diagnostics('reconstruction')
    ros.until(lambda: images and state())
    before = state.value('rig')
    # A second one of the same names is refused.
    second = up(pattern_publisher={'pattern': pattern})
    assert second.wait() == 2
    assert 'pattern_publisher is run by another payload in the ROS domain' in second.output
    # What is written into the rig's file meanwhile is of the next flight.
    rig.write_text('no rig at all')
    nodes = children(payload)
    for node in nodes:
        os.kill(node, signal.SIGKILL)
    again = ros.diagnostics('reconstruction')
    ros.until(lambda: len(images) == 2 and len(children(payload)) == 2)
    ros.until(again)
    assert again.value('rig') == before
    assert bytes(images[0].data) == bytes(images[1].data)
    assert not {*nodes} & {*children(payload)}
    name = f'{ros.namespace}/pattern_publisher'.strip('/')
    assert f'{name} was killed by SIGKILL: restarting it' in payload.output
    assert 'status 2' not in payload.output
    nodes = children(payload)
    assert payload.stop() == 0
    assert all(map(ended, nodes))
    assert payload.output.rstrip().endswith('up | stopped')


def test_names_that_a_node_of_other_making_has_are_refused(ros, up, pattern):
    ros.start('pattern_publisher', pattern=pattern)
    name = f'{ros.namespace}/pattern_publisher'.strip('/')
    with pytest.raises(ConfigurationError, match=f'the name {name} runs already in this domain'):
        # As often as a busy machine needs to find it.
        for _ in range(10):
            refuse_second([name, 'another'])


@pytest.mark.parametrize(
    'parameters',
    ['{rig: shipped:rig.yaml, stride: 2}', '\n    rig: shipped:rig.yaml\n    stride: 0x2g'],
)
def test_what_only_other_parsers_take_starts_nothing(domain, tmp_path, parameters):
    path = tmp_path / 'payload.yaml'
    path.write_text(f'reconstruction:\n  ros__parameters: {parameters}\n')
    with pytest.raises(ConfigurationError, match=f'{path}'):
        check_parameters(fitted(read_configuration(path)))
