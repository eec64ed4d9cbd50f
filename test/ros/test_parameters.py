"""Parameters: of any node, on the page that lists them, and in the shipped configurations."""

from __future__ import annotations

import importlib
import re
import shutil
import socket
from pathlib import Path

import pytest
import rclpy
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.nodes.declarations import fitted
from ftp_dent_ros.parameters import flat
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.supervision.configuration import read_configuration
from ftp_dent_ros.supervision.executables import NODES


@pytest.fixture
def make(ros):
    """Function that makes the parameters of a node to which values were given."""
    nodes = []

    def make_parameters(**given):
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        node = rclpy.create_node(
            'subject',
            context=ros.context,
            namespace=ros.namespace,
            parameter_overrides=overrides,
        )
        nodes.append(node)
        ros.executor.add_node(node)
        return Parameters(node)

    yield make_parameters
    for node in nodes:
        node.destroy_node()


def test_a_change_reaches_the_listener_unless_something_is_wrong_with_it(ros, make):
    parameters, changes = make(), []
    parameters.declare(
        'rate', 5.0, 'Images a second.', minimum=0.0, maximum=100.0, changeable=True
    )
    parameters.declare('rig', 'a.yaml', 'Calibration file.')

    def listen(values):
        if values['rate'] == 6.0:
            raise ConfigurationError('the camera does not do this: take another rate')
        changes.append(values)

    parameters.on_change(listen)

    def changed(name, value):
        words = [Parameter(name, value=value).to_parameter_msg()]
        request = SetParameters.Request(parameters=words)
        return ros.call(SetParameters, 'subject/set_parameters', request).results[0]

    assert changed('rate', 7.5).successful
    for name, value, words in (
        ('rate', 101.0, 'out of range'),
        ('rate', float('nan'), 'out of range'),
        ('rate', 'fast', 'DOUBLE'),
        ('rate', 6.0, 'the camera does not do this: take another rate'),
        ('rig', 'b.yaml', 'read-only'),
    ):
        result = changed(name, value)
        assert not result.successful and words in result.reason
    assert changes == [{'rate': 7.5}] and parameters['rate'] == 7.5


def test_a_file_is_told_with_the_id_of_its_content(make, tmp_path, capfd):
    file = tmp_path / 'rig.yaml'
    file.write_text('one')
    parameters = make(rig=str(file))
    assert parameters.file('rig', '', 'Calibration.') == file
    parameters.close(tuple)
    assert f'rig: {file} (SHA-256 7692c3ad3540...)' in capfd.readouterr().err
    with pytest.raises(ConfigurationError, match=r'parameter rig: .*none.yaml: no such file'):
        make(rig=str(tmp_path / 'none.yaml')).file('rig', '', 'Calibration.')


PAGE = Path(__file__).resolve().parents[2] / 'docs/reference/parameters.md'
# What a node cannot start without, or would disturb another test with.
GIVEN = {
    'pattern_publisher': {'rig': 'shipped:rig.yaml', 'pattern': 'shipped:pattern.yaml'},
    'camera_capture': {'rig': 'shipped:rig.yaml', 'source': 'simulation'},
    'reconstruction': {},
    'mavlink_bridge': {'address': 'udpout:127.0.0.1:9'},
    'dent_inspector': {},
    'survey': {},
    'downlink': {'address': '127.0.0.1:17999'},
    'ground_station': {'address': '127.0.0.1:17998'},
}
OF_ROS = ('qos_overrides.', 'use_sim_time', 'start_type_description_service')


def table(node, given):
    """Lines of a node's table; the default of what was given is left open."""
    lines = ['| parameter | default | |', '| --- | --- | --- |']
    listed = node.list_parameters([], 0).names
    for name in sorted(name for name in listed if not name.startswith(OF_ROS)):
        value = node.get_parameter(name).value
        if name in given:
            default = '?'
        elif hasattr(value, 'tolist'):
            default = ', '.join(f'{number:.4g}' for number in value)
        else:
            default = 'none' if value == '' else str(value).lower()
        lines.append(f'| `{name}` | {default} | {node.describe_parameter(name).description} |')
    return lines


@pytest.mark.parametrize('name', GIVEN)
def test_every_parameter_stands_on_the_page(ros, name):
    module = importlib.import_module(f'ftp_dent_ros.nodes.{name}')
    node = getattr(module, name.title().replace('_', ''))(
        context=ros.context,
        namespace=ros.namespace,
        parameter_overrides=[Parameter(key, value=value) for key, value in GIVEN[name].items()],
    )
    try:
        lines = table(node, GIVEN[name])
    finally:
        node.destroy_node()
    text = PAGE.read_text(encoding='utf-8').partition(f'**`{name}`**')[2]
    section = re.split(r'\n(?:\*\*`|## )', text)[0]
    written = [line for line in section.splitlines() if line.startswith('|')]
    expected = '\n'.join(lines)
    assert len(written) == len(lines), f'the page should have:\n{expected}'
    for line, row in zip(written, lines, strict=True):
        start, _, end = row.partition(' ? ')
        assert line.startswith(start), f'the page should have:\n{expected}'
        assert line.endswith(end), f'the page should have:\n{expected}'


@pytest.mark.parametrize('configuration', ['payload.yaml', 'simulation.yaml'])
def test_every_parameter_is_declared_and_taken(ros, tmp_path, configuration):
    blocks = yaml.safe_load(files.find(f'shipped:{configuration}').read_text())
    # The calibration that a user's payload has beside its configuration.
    shutil.copy(files.find('shipped:rig.yaml'), tmp_path)
    # The address of another test must not be taken, nor may a window open.
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('127.0.0.1', 0))
        address = f'udpin:127.0.0.1:{free.getsockname()[1]}'
    blocks['mavlink_bridge']['ros__parameters']['address'] = address
    blocks['pattern_publisher']['ros__parameters'].pop('display.enabled', None)
    path = tmp_path / configuration
    path.write_text(
        yaml.safe_dump({f'{ros.namespace}/{key}': blocks[key] for key in NODES if key in blocks})
    )
    processes = {
        entry.executable: ros.start(entry.executable, *entry.parameter_words)
        for entry in fitted(read_configuration(path))
    }
    for name, process in processes.items():
        check(ros, name, process, dict(flat(blocks[name]['ros__parameters'])))


def check(ros, name, process, given):
    node = (name, ros.namespace)
    ros.until(lambda: not process.alive or node in ros.node.get_node_names_and_namespaces())
    assert process.alive, process.output
    declared = ros.call(ListParameters, f'{name}/list_parameters', ListParameters.Request())
    assert set(given) <= set(declared.result.names), name
    request = GetParameters.Request(names=list(given))
    response = ros.call(GetParameters, f'{name}/get_parameters', request)
    for parameter, value in zip(given, response.values, strict=True):
        taken = parameter_value_to_python(value)
        taken = list(taken) if isinstance(given[parameter], list) else taken
        if parameter == 'rig' and not given['rig'].startswith('shipped:'):
            taken = Path(taken).name
        assert taken == given[parameter], parameter
