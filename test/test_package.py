"""The package's description, and the configuration files for other programs that it ships."""

import ast
import json
import re
import sys
import warnings
from pathlib import Path

import pytest
import yaml

from ftp_dent_ros import __version__, files
from ftp_dent_ros.supervision.executables import NODES, OPTIONAL

ROOT = Path(__file__).resolve().parents[1]
TOPICS = {
    *('/projector/image_raw', '/projector/camera_info'),
    *('/camera/image_raw', '/camera/camera_info', '/points'),
    *('/tagged/points', '/tagged/pose', '/tagged/camera_pose'),
    *('/mavlink/pose', '/diagnostics'),
    *('/dents', '/dents/list', '/dents/markers'),
    *('/skin', '/survey/pose', '/survey/path', '/survey/coverage'),
}
# What is imported, rosdep's key for it and PyPI's name. rclpy and the messages: ROS's own.
LIBRARIES = {
    'aiohttp': ('python3-aiohttp', 'aiohttp'),
    'cryptography': ('python3-cryptography', 'cryptography'),
    'cv2': ('python3-opencv', 'opencv-python-headless'),
    'jinja2': ('python3-jinja2', 'jinja2'),
    'lz4': ('mcap-ros2-support', 'mcap'),  # mcap brings it
    'matplotlib': ('python3-matplotlib', 'matplotlib'),
    'mcap': ('mcap-ros2-support', 'mcap'),
    'numpy': ('python3-numpy', 'numpy'),
    'pymavlink': ('python3-pymavlink-pip', 'pymavlink'),
    'rosbags': ('python3-rosbags-pip', 'rosbags'),
    'scipy': ('python3-scipy', 'scipy'),
    'serial': ('python3-serial', 'pyserial'),
    'tqdm': ('python3-tqdm', 'tqdm'),
    'yaml': ('python3-yaml', 'pyyaml'),
    'zstandard': ('mcap-ros2-support', 'mcap'),  # mcap brings it
}
# Extras of PyPI that rosdep has no key for.
WITHOUT_KEY = {'distributed': 'distributed', 'zenoh': 'eclipse-zenoh'}
COME_WITH_RCLPY = {'rcl_interfaces', 'builtin_interfaces', 'rosidl_runtime_py', 'rpyutils'}


@pytest.fixture(scope='module')
def package():
    parse = pytest.importorskip('catkin_pkg.package', reason='catkin_pkg is not installed')
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        return parse.parse_package(str(ROOT / 'package.xml'), warnings=(found := [])), found


def imported():
    names = set()
    for path in (ROOT / 'ftp_dent_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.partition('.')[0])
    return names - set(sys.stdlib_module_names) - {'ftp_dent_ros', '__future__'}


def test_the_manifest_is_valid(package):
    manifest, found = package
    assert found == []
    assert manifest.get_build_type() == 'ament_python'
    assert manifest.version == __version__
    assert manifest.licenses == ['Apache-2.0']


def test_the_manifest_and_the_build_file_name_what_is_imported(package):
    keys = {each.name for each in (*package[0].exec_depends, *package[0].build_depends)}
    build_file = (ROOT / 'setup.py').read_text()
    for project in WITHOUT_KEY.values():
        assert f"'{project}" in build_file
    for name in imported() - COME_WITH_RCLPY - set(WITHOUT_KEY):
        key, project = LIBRARIES.get(name, (name, f'ros-{name.replace("_", "-")}'))
        assert key in keys, f'package.xml: {name} needs {key}'
        if name != 'tf2_msgs':  # there are no wheels of it: used where it is
            assert re.search(rf"'{project}[\[>=]", build_file), f'setup.py: {name}: {project}'


def test_the_changelog_knows_this_version():
    assert re.search(rf'^{re.escape(__version__)} \(', (ROOT / 'CHANGELOG.rst').read_text(), re.M)


def strings(data):
    if isinstance(data, dict):
        yield from (text for pair in data.items() for each in pair for text in strings(each))
    elif isinstance(data, list):
        yield from (text for each in data for text in strings(each))
    elif isinstance(data, str):
        yield data


def test_rviz_shows_topics_that_exist():
    layout = yaml.safe_load(files.find('shipped:payload.rviz').read_text())
    displays = layout['Visualization Manager']['Displays']
    shown = {each['Topic']['Value'] for each in displays if 'Topic' in each}
    assert {'/points', '/tagged/points', '/tagged/pose', '/camera/image_raw'} <= shown <= TOPICS
    assert '/dents/markers' in shown


def test_foxglove_shows_topics_that_exist():
    layout = json.loads(files.find('shipped:foxglove.json').read_text())
    panels = layout['configById']
    placed = {text for text in strings(layout['layout']) if '!' in text}
    assert placed == set(panels)
    shown = {*panels['3D!payload']['topics'], panels['DiagnosticSummary!payload']['topicToRender']}
    shown |= {panels['Image!camera']['imageMode']['imageTopic']}
    shown |= {path['value'].partition('.')[0] for path in panels['Plot!position']['paths']}
    assert shown <= TOPICS


def test_qos_overrides_are_those_of_the_bag_tools():
    overrides = yaml.safe_load(files.find('shipped:qos_overrides.yaml').read_text())
    assert set(overrides) == TOPICS
    for topic, policies in overrides.items():
        assert set(policies) == {'history', 'depth', 'reliability', 'durability'}
        assert policies['reliability'] == 'reliable'
        latched = topic.startswith(('/projector/', '/dents/', '/survey/path', '/survey/coverage'))
        assert policies['durability'] == ('transient_local' if latched else 'volatile')


# Of launch and launch_ros in Jazzy, which are on no package index: what the launch file may use.
LAUNCH = {
    'launch': {'LaunchContext', 'LaunchDescription', 'LaunchDescriptionEntity'},
    'launch.actions': {
        *('DeclareLaunchArgument', 'ExecuteProcess', 'LogInfo', 'OpaqueFunction'),
        *('SetEnvironmentVariable', 'TimerAction'),
    },
    'launch.events.process': {'ProcessExited'},
    'launch.substitutions': {'LaunchConfiguration'},
    'launch_ros.actions': {'Node'},
}


def test_the_launch_file_uses_what_launch_has():
    tree = ast.parse((ROOT / 'launch' / 'payload.launch.py').read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module.startswith('launch'):
            assert {alias.name for alias in node.names} <= LAUNCH[node.module]
    assert 'generate_launch_description' in {getattr(node, 'name', '') for node in tree.body}


def test_the_launch_file_starts_what_up_starts():
    """Where ROS is; the tests of a pip installation cannot have launch."""
    launch_ros = pytest.importorskip('launch_ros.actions', reason='launch_ros is not installed')
    import runpy

    import launch

    module = runpy.run_path(str(ROOT / 'launch' / 'payload.launch.py'))
    context = launch.LaunchContext()
    context.launch_configurations['configuration'] = 'shipped:simulation.yaml'
    context.launch_configurations['interface'] = 'lo'
    actions = module['payload'](context)
    nodes = [each for each in actions if isinstance(each, launch_ros.Node)]
    assert {each.node_executable for each in nodes} == set(NODES) - OPTIONAL
    (description,) = (module['generate_launch_description'](),)
    assert len(description.entities) == 3
