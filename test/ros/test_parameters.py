from __future__ import annotations

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, SetParameters
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


def test_a_value_that_was_not_given_is_the_default(make):
    parameters = make()
    assert declare_rate(parameters) == 5.0 == parameters['rate']


def test_a_whole_number_serves_for_a_floating_point_one(make):
    rate = declare_rate(make(rate=9))
    assert (rate, type(rate)) == (9.0, float)


@pytest.mark.parametrize(
    ('default', 'value', 'sentence'),
    [
        (5.0, 'fast', 'give a number'),
        (5.0, float('nan'), 'finite'),
        (5.0, -1, 'from 0 to 100'),
        (5.0, 100.5, 'from 0 to 100'),
        (5.0, True, 'give a number'),
        (3, 2.5, 'whole number'),
        (3, 101, 'from 0 to 100'),
        (True, 1, 'true or false'),
        ('a', 7, 'in quotes'),
        ([1.0, 2.0], [1.0], 'give 2 numbers'),
        ([1.0, 2.0], 3.0, 'give 2 numbers'),
        ([1.0, 2.0], ['x', 'y'], 'give a number'),
        ([1.0, 2.0], [1.0, 300.0], 'from 0 to 100'),
    ],
)
def test_a_wrong_value_is_refused_with_a_sentence(make, default, value, sentence):
    numeric = not isinstance(default, (str, bool))
    span = {'minimum': 0, 'maximum': 100} if numeric else {}
    with pytest.raises(ConfigurationError, match=sentence) as caught:
        make(subject=value).declare('subject', default, 'A test.', **span)
    assert str(caught.value).startswith('parameter subject is ')


def test_a_text_must_be_one_of_the_choices(make):
    with pytest.raises(ConfigurationError, match='give direct or virtual-reference'):
        make(method='fourier').declare(
            'method', 'direct', 'How.', choices=('direct', 'virtual-reference')
        )


def test_a_parameter_describes_itself(ros, make):
    parameters = make()
    declare_rate(parameters)
    parameters.declare('rig', '', 'Calibration file.')
    request = DescribeParameters.Request(names=['rate', 'rig'])
    rate, rig = ros.call(DescribeParameters, 'subject/describe_parameters', request).descriptors
    assert (rate.type, rate.description) == (ParameterType.PARAMETER_DOUBLE, 'Images a second.')
    assert rate.floating_point_range[0].to_value == 100.0
    assert (rate.read_only, rig.read_only) == (False, True)


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


@pytest.mark.parametrize('given', ['rat', 'nothing.like.it'])
def test_what_no_node_declares_is_refused_with_the_nearest_name(make, given):
    parameters = make(**{given: 1})
    declare_rate(parameters)
    near = 'did you mean rate?' if given == 'rat' else 'there are rate'
    with pytest.raises(ConfigurationError, match=f'no parameter {given}: {near}'):
        parameters.close(lambda: ('stride',))


def test_the_end_that_is_excluded_cannot_be_set_either(ros, make):
    parameters = make()
    parameters.declare('tau', 0.8, 'Gain.', above=0.0, maximum=1.0, changeable=True)
    result = set_remotely(ros, 'tau', 0.0)
    assert not result.successful and 'above 0' in result.reason
    assert parameters['tau'] == 0.8


def test_a_file_is_told_with_the_id_of_its_content(make, tmp_path, capfd):
    file = tmp_path / 'rig.yaml'
    file.write_text('one')
    parameters = make(rig=str(file))
    assert parameters.file('rig', '', 'Calibration.') == file
    parameters.close(tuple)
    assert f'rig: {file} (SHA-256 7692c3ad3540...)' in capfd.readouterr().err
    with pytest.raises(ConfigurationError, match=r'parameter rig: .*none.yaml: no such file'):
        make(rig=str(tmp_path / 'none.yaml')).file('rig', '', 'Calibration.')
