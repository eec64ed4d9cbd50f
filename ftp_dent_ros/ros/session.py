"""What commands need of ROS: a node, and whether a payload may be started."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ftp_dent_ros.errors import ConfigurationError, printable
from ftp_dent_ros.ros.qos import DIAGNOSTICS
from ftp_dent_ros.supervision import transport
from ftp_dent_ros.supervision.configuration import NodeEntry
from ftp_dent_ros.supervision.executables import NODES
from ftp_dent_ros.supervision.processes import stop_event_meanwhile


def say(text: str) -> None:
    """Tell the user a line."""
    print(printable(text), file=sys.stderr, flush=True)


@contextmanager
def session(name: str, arguments: Sequence[str] = ()) -> Iterator[tuple[Node, threading.Event]]:
    """Node of a command, and an event that is set when the command is to end.

    The event is set by SIGINT, SIGTERM and SIGHUP; rclpy's own handlers would shut the context
    down before what has arrived is dealt with. To be used in the main thread.

    Parameters
    ----------
    name : str
        Of the node.
    arguments : sequence of str, optional
        What would follow ``--ros-args``.

    Raises
    ------
    ConfigurationError
        The arguments are not understood.
    """
    with (
        stop_event_meanwhile() as stop,
        transport.profile() as variables,
        transport.environment_of(variables),
        ExitStack() as ending,
    ):
        try:
            rclpy.init(
                args=['--ros-args', *arguments], signal_handler_options=SignalHandlerOptions.NO
            )
        except Exception as reason:
            why = str(reason).splitlines()[0]
            raise ConfigurationError(
                f'{" ".join(arguments)}: not understood by ROS ({why}): correct it'
            ) from None
        ending.callback(rclpy.try_shutdown)
        node = Node(name, enable_rosout=False, start_parameter_services=False)
        ending.callback(node.destroy_node)
        yield node, stop


def check_parameters(entries: Iterable[NodeEntry]) -> None:
    """Have ROS's own parser read the nodes' parameters: it takes less of YAML than others do.

    Raises
    ------
    ConfigurationError
        It does not understand them.
    """
    for entry in entries:
        if entry.executable not in NODES:
            continue
        context = rclpy.Context()
        try:
            context.init(['--ros-args', *entry.parameter_words])
        except Exception as reason:
            why = str(reason).splitlines()[0]
            raise ConfigurationError(
                f'{entry.file}: not understood by ROS ({why}): write mappings and lists over '
                'several lines, and texts in quotes'
            ) from None
        finally:
            context.try_shutdown()


def refuse_second(names: Collection[str]) -> None:
    """Refuse to start nodes whose names are in use: two cameras would feed one reconstruction.

    Parameters
    ----------
    names : collection of str
        Fully qualified, without the leading slash.

    Raises
    ------
    ConfigurationError
        One of them lives, as far as that shows within a few seconds.
    """
    wanted, heard = set(names), set[str]()
    with session('presence') as (node, stop):

        def listen(message: DiagnosticArray) -> None:
            heard.update(wanted & {status.name for status in message.status})

        node.create_subscription(DiagnosticArray, '/diagnostics', listen, DIAGNOSTICS)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        start = time.monotonic()
        longest = 2.0  # in which participants on one network find each other
        while not (stop.is_set() or heard) and time.monotonic() < start + longest:
            executor.spin_once(timeout_sec=0.1)
            found = node.get_node_names_and_namespaces()
            if wanted & {f'{namespace}/{name}'.strip('/') for name, namespace in found}:
                # A node that lives states so every second; a killed one is named for longer.
                longest = 3.0
        executor.shutdown()
        if stop.is_set():
            raise KeyboardInterrupt
    if heard:
        raise ConfigurationError(
            f'a node of the name {min(heard)} runs already in this domain: end it, or take '
            'another namespace or ROS_DOMAIN_ID'
        )
