"""A thread that works on the newest items, so that the executor stays free."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar('Item')
# With the one in work, a second and a half of photographs at 2 Hz: as long as a process of a busy
# computer stands still now and then. On one that is too slow for good each makes the next later.
WAITING = 2


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
