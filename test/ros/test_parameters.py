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


def declare_rate(parameters):
    return parameters.declare(
        'rate', 5.0, 'Images a second.', minimum=0.0, maximum=100.0, changeable=True
    )


def set_remotely(ros, name, value):
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return ros.call(SetParameters, 'subject/set_parameters', request).results[0]


def test_a_change_reaches_the_listener_and_the_value(ros, make):
    parameters, changes = make(), []
    declare_rate(parameters)
    parameters.on_change(changes.append)
    assert set_remotely(ros, 'rate', 7.5).successful
    assert changes == [{'rate': 7.5}] and parameters['rate'] == 7.5


@pytest.mark.parametrize(
    ('value', 'word'),
    [(101.0, 'out of range'), (float('nan'), 'out of range'), ('fast', 'DOUBLE')],
)
def test_a_wrong_change_is_refused_and_changes_nothing(ros, make, value, word):
    parameters, changes = make(), []
    declare_rate(parameters)
    parameters.on_change(changes.append)
    result = set_remotely(ros, 'rate', value)
    assert not result.successful and word in result.reason
    assert changes == [] and parameters['rate'] == 5.0


def test_a_listener_can_refuse_with_its_reason(ros, make):
    def refuse(values):
        raise ConfigurationError('the camera does not do this: take another rate')

    parameters = make()
    declare_rate(parameters)
    parameters.on_change(refuse)
    result = set_remotely(ros, 'rate', 6.0)
    assert (result.successful, parameters['rate']) == (False, 5.0)
    assert result.reason == 'the camera does not do this: take another rate'


def test_a_fixed_parameter_cannot_be_changed(ros, make):
    make().declare('rig', 'a.yaml', 'Calibration file.')
    result = set_remotely(ros, 'rig', 'b.yaml')
    assert not result.successful and 'read-only' in result.reason


def test_a_file_is_told_with_the_id_of_its_content(make, tmp_path, capfd):
    file = tmp_path / 'rig.yaml'
    file.write_text('one')
    parameters = make(rig=str(file))
    assert parameters.file('rig', '', 'Calibration.') == file
    parameters.close(tuple)
    assert f'rig: {file} (SHA-256 7692c3ad3540...)' in capfd.readouterr().err
    with pytest.raises(ConfigurationError, match=r'parameter rig: .*none.yaml: no such file'):
        make(rig=str(tmp_path / 'none.yaml')).file('rig', '', 'Calibration.')
