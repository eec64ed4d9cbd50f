"""How every node of the package runs as a process."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.node import Node

from ftp_dent_ros.errors import FtpDentError


def run(
    make_node: Callable[[], Node],
    name: str,
    arguments: Sequence[str] | None = None,
    threads: int = 1,
) -> int:
    """Run a node until SIGINT or SIGTERM.

    An exception of a callback is logged and the node goes on: a message from anywhere must not
    end it. What a node holds (threads, devices, sockets) it lets go in its `destroy_node`.

    Parameters
    ----------
    make_node : callable
        The node's class.
    name : str
        Name of the executable, for messages.
    arguments : sequence of str, optional
        ``sys.argv`` by default.
    threads : int
        More than one for a node with a callback that waits.

    Returns
    -------
    int
        Exit status: 0 after a signal, 2 if the parameters or arguments are wrong (one line on
        stderr).
    """
    node: Node | None = None
    executor: Executor | None = None
    try:
        rclpy.init(args=None if arguments is None else list(arguments))
        executor = SingleThreadedExecutor() if threads == 1 else MultiThreadedExecutor(threads)
        node = make_node()
        executor.add_node(node)
        while rclpy.ok():
            _spin_once(executor, node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except FtpDentError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except Exception as error:
        if node is not None or not _is_of_rclpy(error):
            raise
        # Else a signal came while the node was being made.
        if executor is None or rclpy.ok():
            print(f'{name}: {str(error).splitlines()[0]}', file=sys.stderr)
            return 2
    finally:
        # A second signal must not interrupt the cleaning up.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _is_of_rclpy(error: Exception) -> bool:
    """Whether rclpy complains: of arguments, of a QoS override or of the environment."""
    return isinstance(error, RuntimeError) or type(error).__module__.startswith('rclpy')


def _spin_once(executor: Executor, node: Node) -> None:
    # The timeout matters: without it a signal is missed now and then.
    try:
        executor.spin_once(timeout_sec=0.5)
    except ExternalShutdownException:
        raise
    except Exception as error:
        if rclpy.ok():
            node.get_logger().error(
                f'unexpected {type(error).__name__}: {error}\n{traceback.format_exc()}'
            )
