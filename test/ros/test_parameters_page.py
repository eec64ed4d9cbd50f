"""The tables of docs/reference/parameters.md are what the nodes declare."""

import importlib
import re
from pathlib import Path

import pytest

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
    from rclpy.parameter import Parameter

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
