"""How every node of the package runs as a process."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.supervision import gate
from ftp_dent_ros.supervision.hearing import Hearing
from ftp_dent_ros.supervision.signals import stop_event

# A signal is noticed after that long at most, seconds.
_LONGEST_WAIT = 0.2
# For a callback that waits.
_TIME_TO_END = 2.0


class ThreadedExecutor(MultiThreadedExecutor):
    """rclpy's, which at its end destroys what callbacks under way still use, and prints that."""

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Let callbacks under way end first, as rclpy documents it."""
        # All of the pool's threads end with the callbacks that they have taken.
        ended = threading.Thread(target=self._executor.shutdown, daemon=True)
        ended.start()
        ended.join(timeout_sec)
        return bool(super().shutdown(0)) and not ended.is_alive()


def run(
    make_node: Callable[[], Node],
    name: str,
    arguments: Sequence[str] | None = None,
    threads: int = 1,
) -> int:
    """Run a node until SIGINT, SIGTERM or SIGHUP.

    An exception of a callback is logged and the node goes on: a message from anywhere must not
    end it. What a node holds (threads, devices, sockets) it lets go in its `destroy_node`. A node
    to which the transport brings nothing any more is made anew.

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
    if not gate.wait():
        return 0
    stop = stop_event()
    while (status := _run_until_deaf(make_node, name, arguments, threads, stop)) is None:
        pass
    return status


def _run_until_deaf(
    make_node: Callable[[], Node],
    name: str,
    arguments: Sequence[str] | None,
    threads: int,
    stop: threading.Event,
) -> int | None:
    """Exit status, as `run`; None if the node has to be made anew."""
    node: Node | None = None
    executor: Executor | None = None
    hearing = Hearing()
    try:
        # Not rclpy's own handlers: they end the context while threads still publish.
        rclpy.init(
            args=None if arguments is None else list(arguments),
            signal_handler_options=SignalHandlerOptions.NO,
        )
        executor = SingleThreadedExecutor() if threads == 1 else ThreadedExecutor(threads)
        node = make_node()
        executor.add_node(node)
        while rclpy.ok() and not stop.is_set():
            _spin_once(executor, node)
            if hearing.is_lost():
                node.get_logger().error(
                    'nothing comes through the shared memory any more: begun anew'
                )
                return None
    except FtpDentError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except Exception as error:
        if node is not None or not _is_of_rclpy(error):
            raise
        print(f'{name}: {str(error).splitlines()[0]}', file=sys.stderr)
        return 2
    finally:
        if executor is not None:
            executor.shutdown(_TIME_TO_END)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _is_of_rclpy(error: Exception) -> bool:
    """Whether rclpy complains: of arguments, of a QoS override or of the environment."""
    return isinstance(error, RuntimeError) or type(error).__module__.startswith('rclpy')


def _spin_once(executor: Executor, node: Node) -> None:
    try:
        executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except Exception as error:
        node.get_logger().error(
            f'unexpected {type(error).__name__}: {error}\n{traceback.format_exc()}'
        )
