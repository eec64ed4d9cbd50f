"""The threads of a node: of its callbacks, and of its work."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from rclpy.executors import MultiThreadedExecutor

from ftp_dent_ros.ros.diagnostics import Diagnostics

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


class NewestWorker(Generic[Item]):
    """Calls a function with one item after the other; of too many the oldest are dropped.

    Parameters
    ----------
    diagnostics : Diagnostics
        Counts what is dropped, and takes what the function raises.
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
