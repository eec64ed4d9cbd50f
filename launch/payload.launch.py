"""The payload on a full ROS machine.

::

    ros2 launch ftp_dent_ros payload.launch.py [configuration:=simulation.yaml]

Runs what ``ftp-dent up`` runs, of the same file: see `ftp_dent_ros.ros.configuration`.
"""

import atexit
from contextlib import ExitStack

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from ftp_dent_ros.ros import transport
from ftp_dent_ros.ros.configuration import NODES, Entry, read_configuration

KEPT_RUNNING = {'output': 'screen', 'respawn': True, 'respawn_delay': 2.0}


def generate_launch_description() -> LaunchDescription:
    """What ``ros2 launch`` asks for."""
    argument = DeclareLaunchArgument(
        'configuration',
        default_value='payload.yaml',
        description='a parameter file, or the name of a shipped one',
    )
    return LaunchDescription([argument, OpaqueFunction(function=payload)])


def payload(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """The processes of the configuration, on the transport that they need."""
    entries = read_configuration(LaunchConfiguration('configuration').perform(context))
    stack = ExitStack()
    atexit.register(stack.close)
    variables = stack.enter_context(transport.profile(len(entries) + 3))
    return [
        *(SetEnvironmentVariable(name, value) for name, value in variables.items()),
        *(process(entry) for entry in entries),
    ]


def process(entry: Entry) -> LaunchDescriptionEntity:
    """One entry of the configuration."""
    if entry.executable not in NODES:
        return ExecuteProcess(cmd=list(entry.program.command), name=entry.name, **KEPT_RUNNING)
    return Node(
        package='ftp_dent_ros',
        executable=entry.executable,
        name=entry.executable,
        namespace=entry.namespace,
        parameters=[str(entry.file)],
        **KEPT_RUNNING,
    )
