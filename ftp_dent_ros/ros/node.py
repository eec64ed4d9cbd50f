"""How every node of the package runs as a process, and the thread of its work."""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import Generic, TypeVar

import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ftp_dent_ros.errors import FtpDentError, missing_package
from ftp_dent_ros.ros.diagnostics import Diagnostics
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


def run(make_node: Callable[[], Node], name: str, threads: int = 1) -> int:
    """Run a node until SIGINT, SIGTERM or SIGHUP.

    An exception of a callback is logged and the node goes on: a message from anywhere must not
    end it. What a node holds (threads, devices, sockets) it lets go in its `destroy_node`.

    Parameters
    ----------
    make_node : callable
        The node's class.
    name : str
        Name of the executable, for messages.
    threads : int
        More than one for a node with a callback that waits.

    Returns
    -------
    int
        Exit status: 0 after a signal, 2 if the parameters or arguments are wrong (one line on
        stderr).
    """
    stop = stop_event()
    with ExitStack() as ending:
        try:
            # Not rclpy's own handlers: they end the context while threads still publish.
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            ending.callback(rclpy.try_shutdown)
            node = make_node()
        except ModuleNotFoundError as error:
            print(f'{name}: {missing_package(error)}', file=sys.stderr)
            return 2
        except Exception as error:
            # Of ours, or rclpy's: of arguments, of a QoS override or of the environment.
            known = isinstance(error, (FtpDentError, RuntimeError))
            if not known and not type(error).__module__.startswith('rclpy'):
                raise
            print(f'{name}: {str(error).splitlines()[0]}', file=sys.stderr)
            return 2
        ending.callback(node.destroy_node)
        executor = SingleThreadedExecutor() if threads == 1 else ThreadedExecutor(threads)
        ending.callback(executor.shutdown, 2.0)  # for a callback that waits
        executor.add_node(node)
        while rclpy.ok() and not stop.is_set():
            try:
                executor.spin_once(timeout_sec=0.2)
            except Exception as error:  # noqa: PERF203
                node.get_logger().error(
                    f'unexpected {type(error).__name__}: {error}\n{traceback.format_exc()}'
                )
    return 0


class NewestWorker(Generic[Item]):
    """Calls a function with one item after the other; of too many the oldest are dropped.

    Parameters
    ----------
    diagnostics : Diagnostics
        Told what is dropped, and what the function raises.
    work : callable
    what : str
        Could not be done, in a sentence on a defect of the software.
    room : int
        How many may wait.
    rest : float
        Seconds from one item to the next at least, for what grows with a flight and is made of
        the newest state alone: that rests for 20 times as long as it worked, too, and what is
        replaced meanwhile is no loss. 0 for every item in its turn.
    """

    def __init__(
        self,
        diagnostics: Diagnostics,
        work: Callable[[Item], None],
        what: str,
        room: int = WAITING,
        rest: float = 0.0,
    ) -> None:
        self._diagnostics, self._work, self._what = diagnostics, work, what
        self._rest = rest
        self._changed = threading.Condition()
        self._waiting: deque[Item] = deque(maxlen=1 if rest else room)
        self._working: list[Item] = []
        self._stopped = self._finishing = False
        self._thread = threading.Thread(target=self._run, name=work.__name__, daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """How many wait or are worked on."""
        return len(self._left())

    def put(self, item: Item) -> None:
        """Hand over an item; the oldest that nobody had taken may be dropped for it."""
        with self._changed:
            if len(self._waiting) == self._waiting.maxlen and not self._rest:
                self._diagnostics.count('dropped')
            self._waiting.append(item)
            self._changed.notify_all()

    def settle(self, seconds: float) -> bool:
        """Wait until all that was put before is done or dropped; whether it is in that time."""
        with self._changed:
            before = self._left()
            return self._changed.wait_for(
                lambda: not any(item is each for item in before for each in self._left()), seconds
            )

    def stop(self, finish: bool = False) -> None:
        """Finish the item in work, and those that wait if asked to, and end the thread."""
        with self._changed:
            self._stopped, self._finishing = True, finish
            self._changed.notify_all()
        self._thread.join()

    def _left(self) -> list[Item]:
        """What is worked on and what waits."""
        return [*self._working, *self._waiting]

    def _run(self) -> None:
        rest = 0.0
        while True:
            with self._changed:
                self._working.clear()
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._stopped, rest)
                self._changed.wait_for(lambda: self._waiting or self._stopped)
                if self._stopped and not (self._finishing and self._waiting):
                    return
                item = self._waiting.popleft()
                self._working.append(item)
            started = time.monotonic()
            with self._diagnostics.guarded(self._what):
                self._work(item)
            if self._rest:
                rest = max(self._rest, 20 * (time.monotonic() - started))
