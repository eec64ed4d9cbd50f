"""How every node of the package runs as a process, and the thread of its work."""

from __future__ import annotations

import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import rclpy
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.supervision.processes import stop_event

Item = TypeVar('Item')
# With the one in work, a second and a half of photographs at 2 Hz: as long as a process of a busy
# computer stands still now and then. On one that is too slow for good each makes the next later.
WAITING = 2


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


class NewestWorker(Generic[Item]):
    """Calls a function with one item after the other; of too many the oldest are dropped.

    Parameters
    ----------
    work : callable
        It has to catch its own errors.
    name : str
        Name of the thread.
    room : int
        How many may wait.
    """

    def __init__(self, work: Callable[[Item], None], name: str, room: int = WAITING) -> None:
        self._work = work
        self._changed = threading.Condition()
        self._waiting: deque[Item] = deque(maxlen=room)
        self._stopped = self._finishing = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, item: Item) -> Item | None:
        """Hand over an item; the oldest that nobody had taken if it was dropped for it."""
        with self._changed:
            full = len(self._waiting) == self._waiting.maxlen
            dropped = self._waiting.popleft() if full else None
            self._waiting.append(item)
            self._changed.notify()
            return dropped

    def stop(self, finish: bool = False) -> None:
        """Finish the item in work, and those that wait if asked to, and end the thread."""
        with self._changed:
            self._stopped, self._finishing = True, finish
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._stopped)
                if self._stopped and not (self._finishing and self._waiting):
                    return
                item = self._waiting.popleft()
            self._work(item)
