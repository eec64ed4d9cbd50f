from __future__ import annotations

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.ros.parameters import Parameters


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
