"""The payload on a full ROS machine.

::

    ros2 launch ftp_dent_ros payload.launch.py configuration:=my_payload.yaml [interface:=lo]

Runs what ``ftp-dent up`` runs, of the same file: see `ftp_dent_ros.supervision.configuration`.
"""

import atexit
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    LogInfo,
    OpaqueFunction,
    SetEnvironmentVariable,
    TimerAction,
)
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from ftp_dent_ros.nodes.settings import fitted
from ftp_dent_ros.ros.session import check_parameters, refuse_second
from ftp_dent_ros.supervision.configuration import NodeEntry, frozen, read_configuration
from ftp_dent_ros.supervision.executables import NODES
from ftp_dent_ros.supervision.processes import respawn_delay, verdict
from ftp_dent_ros.supervision.transport import environment_of, held_names, profile


def generate_launch_description() -> LaunchDescription:
    """What ``ros2 launch`` asks for."""
    configuration = DeclareLaunchArgument(
        'configuration',
        description='a parameter file; a shipped one is shipped:simulation.yaml',
    )
    interface = DeclareLaunchArgument(
        'interface',
        default_value='',
        description='name or address of the only network interface that ROS uses; lo for none',
    )
    return LaunchDescription([configuration, interface, OpaqueFunction(function=payload)])


def payload(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """The processes of the configuration, on the transport that they need."""
    name = LaunchConfiguration('configuration').perform(context)
    entries = fitted(read_configuration(name))
    stack = ExitStack()
    atexit.register(stack.close)
    check_parameters(entries)
    names = [entry.name for entry in entries]
    stack.enter_context(held_names(names))
    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix='ftp_dent_ros.'))
    interface = LaunchConfiguration('interface').perform(context)
    variables = stack.enter_context(profile(interface))
    with environment_of(variables):
        refuse_second(names)
    entries = frozen(entries, Path(folder))
    return [
        *(SetEnvironmentVariable(name, value) for name, value in variables.items()),
        *(process(entry) for entry in entries),
    ]


def process(entry: NodeEntry, before: float = 0.0) -> LaunchDescriptionEntity:
    """One entry of the configuration, kept running as ``ftp-dent up`` does it."""
    began = time.monotonic()

    def ended(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        if context.is_shutdown:
            return []
        delay = respawn_delay(event.returncode, time.monotonic() - began, before)
        told = LogInfo(msg=f'{entry.name} ended with status {event.returncode}: {verdict(delay)}')
        if delay is None:
            return [told]
        again = OpaqueFunction(function=lambda context: [process(entry, delay)])
        return [told, TimerAction(period=delay, actions=[again])]

    if entry.executable not in NODES:
        return ExecuteProcess(
            cmd=list(entry.program.command), name=entry.name, output='screen', on_exit=ended
        )
    return Node(
        package='ftp_dent_ros',
        executable=entry.executable,
        name=entry.executable,
        namespace=entry.namespace,
        parameters=[str(entry.file), *([dict(entry.absolute)] if entry.absolute else [])],
        output='screen',
        on_exit=ended,
    )
