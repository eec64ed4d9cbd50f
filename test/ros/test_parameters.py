"""Parameters: of any node, on the page that lists them, and in the shipped configurations."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.nodes.__main__ import node_class
from ftp_dent_ros.nodes.settings import fitted
from ftp_dent_ros.ros.parameters import Parameters
from ftp_dent_ros.ros.session import check_parameters
from ftp_dent_ros.supervision.configuration import read_configuration


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
    node = node_class(name)(
        context=ros.context,
        namespace=ros.namespace,
        parameter_overrides=[Parameter(key, value=value) for key, value in GIVEN[name].items()],
    )
    try:
        node.start()
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
def test_a_shipped_configuration_is_taken_by_its_nodes_and_by_ros(domain, tmp_path, configuration):
    # The calibration that a user's payload has beside its configuration.
    for name in (configuration, 'rig.yaml'):
        shutil.copy(files.find(f'shipped:{name}'), tmp_path)
    check_parameters(fitted(read_configuration(tmp_path / configuration)))
