"""The nodes know every parameter that the shipped configurations set."""

import shutil
import socket
from pathlib import Path

import pytest
import yaml

from ftp_dent_ros import files
from ftp_dent_ros.nodes.declarations import fitted
from ftp_dent_ros.parameters import flat
from ftp_dent_ros.supervision.configuration import read_configuration
from ftp_dent_ros.supervision.executables import NODES


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
    from rcl_interfaces.srv import GetParameters, ListParameters
    from rclpy.parameter import parameter_value_to_python

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
