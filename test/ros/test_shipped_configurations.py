"""The nodes know every parameter that the shipped configurations set."""

import pytest
import yaml

from ftp_dent_ros import files
from ftp_dent_ros.ros.configuration import NODES, read_configuration


def flat(parameters, prefix=''):
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from flat(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}', value


@pytest.mark.parametrize('configuration', ['payload.yaml', 'simulation.yaml'])
def test_every_parameter_is_declared_and_taken(ros, tmp_path, configuration):
    from rcl_interfaces.srv import GetParameters, ListParameters
    from rclpy.parameter import parameter_value_to_python

    blocks = yaml.safe_load(files.find(configuration).read_text())
    # The address of another test must not be taken, nor may a window open.
    blocks['mavlink_bridge']['ros__parameters']['address'] = 'udpin:127.0.0.1:0'
    blocks['pattern_publisher']['ros__parameters'].pop('display.enabled', None)
    path = tmp_path / configuration
    path.write_text(yaml.safe_dump({f'{ros.namespace}/{key}': blocks[key] for key in NODES}))
    for entry in read_configuration(path):
        ros.start(entry.executable, '--params-file', str(path))
    for name in NODES:
        given = dict(flat(blocks[name]['ros__parameters']))
        listed = ros.call(ListParameters, f'{name}/list_parameters', ListParameters.Request())
        assert set(given) <= set(listed.result.names), name
        request = GetParameters.Request(names=list(given))
        values = ros.call(GetParameters, f'{name}/get_parameters', request).values
        assert [parameter_value_to_python(each) for each in values] == [
            pytest.approx(value) if isinstance(value, list) else value for value in given.values()
        ]
