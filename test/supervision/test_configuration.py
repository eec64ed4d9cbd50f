import sys
from pathlib import Path

import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.nodes.settings import fitted
from ftp_dent_ros.supervision.configuration import frozen, read_configuration


def write(tmp_path, text):
    path = tmp_path / 'payload.yaml'
    path.write_text(text)
    return path


def test_namespaces(tmp_path):
    path = write(
        tmp_path,
        '/**: {ros__parameters: {rig: rig.yaml}}\n'
        'camera_capture: {ros__parameters: {rate: 2.0}}\n'
        '/drone/left/camera_capture: {ros__parameters: }\n',
    )
    plain, left = read_configuration(path)
    assert (plain.name, plain.namespace) == ('camera_capture', '/')
    assert (left.name, left.namespace) == ('drone/left/camera_capture', '/drone/left')
    assert left.program.command == (
        *(sys.executable, '-m', 'ftp_dent_ros.nodes', 'camera_capture', '--ros-args'),
        *('-r', '__node:=camera_capture', '-r', '__ns:=/drone/left'),
        *('--params-file', str(path)),
    )


def test_the_simulated_autopilot_has_options(tmp_path):
    path = write(
        tmp_path,
        'simulated_autopilot:\n  ros__parameters:\n'
        '    address: udpout:127.0.0.1:14550\n    start_ns: -5\n',
    )
    (entry,) = read_configuration(path)
    assert entry.program.command == (
        *(sys.executable, '-m', 'ftp_dent_ros.simulation.autopilot'),
        *('--address=udpout:127.0.0.1:14550', '--start-ns=-5'),
    )


@pytest.mark.parametrize(
    'key', ['"a b"', '"3"', '/left//reconstruction', '/', '"reconstruction;"']
)
def test_a_key_is_the_name_of_a_node(tmp_path, key):
    with pytest.raises(ConfigurationError, match='is no name of a node'):
        read_configuration(write(tmp_path, f'{key}: {{ros__parameters: {{}}}}'))


def test_a_node_is_there_once(tmp_path):
    text = '/reconstruction: {ros__parameters: {}}\nreconstruction: {ros__parameters: {}}\n'
    with pytest.raises(ConfigurationError, match='reconstruction is there twice'):
        read_configuration(write(tmp_path, text))


def test_the_files_of_a_flight_are_those_of_its_start(tmp_path):
    for name in ('rig', 'pattern'):
        (tmp_path / f'{name}.yaml').write_bytes(find(f'shipped:{name}.yaml').read_bytes())
    text = 'left/reconstruction:\n  ros__parameters:\n    rig: rig.yaml\n'
    (entry,) = frozen(fitted(read_configuration(write(tmp_path, text))), tmp_path / 'run')
    (tmp_path / 'rig.yaml').write_text('of another rig')
    (tmp_path / 'payload.yaml').write_text('of another payload')
    assert entry.file.read_text() == text
    assert Path(entry.absolute['rig']).read_bytes() == find('shipped:rig.yaml').read_bytes()
    assert f'rig:="{entry.absolute["rig"]}"' in entry.program.command
