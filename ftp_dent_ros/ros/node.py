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
from ftp_dent_ros.supervision.processes import stop_event


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
    stop = stop_event()
    node: Node | None = None
    executor: Executor | None = None
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
            try:
                executor.spin_once(timeout_sec=0.2)
            except Exception as error:  # noqa: PERF203
                node.get_logger().error(
                    f'unexpected {type(error).__name__}: {error}\n{traceback.format_exc()}'
                )
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
            executor.shutdown(2.0)  # for a callback that waits
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _is_of_rclpy(error: Exception) -> bool:
    """Whether rclpy complains: of arguments, of a QoS override or of the environment."""
    return isinstance(error, RuntimeError) or type(error).__module__.startswith('rclpy')
