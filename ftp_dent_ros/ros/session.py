"""What a command needs of ROS: a node, and to be told to stop without being broken into."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision import transport
from ftp_dent_ros.supervision.signals import stop_event_meanwhile

_PARTICIPANTS = 8  # a payload and a few tools, for the share of the shared memory


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
        transport.profile(_PARTICIPANTS) as variables,
        transport.environment_of(variables),
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
        try:
            node = Node(name, enable_rosout=False, start_parameter_services=False)
            try:
                yield node, stop
            finally:
                node.destroy_node()
        finally:
            rclpy.try_shutdown()
