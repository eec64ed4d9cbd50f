"""Whether this process still hears what others send through the shared memory of Fast DDS.

A process that stands still for a second is given up: those that send to it make its port anew,
again and again, and so does the process itself when it goes on. When both do that at the same
moment, the file of the one takes the place of the other's, and the process listens for good where
nobody can reach it.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from pathlib import Path

from ftp_dent_ros.supervision.shared_memory import FOLDER

_PORT = re.compile(re.escape(FOLDER) + r'/(fastrtps_port\d+)(_el)?( \(deleted\))?$')
# Standing still for less, seconds, gives nobody up: Fast DDS's own patience.
_PATIENCE = 1.0
# For how long after it the ports are looked at, and how often; they are made anew meanwhile.
_WATCHED, _PERIOD = 10.0, 1.0
# As often in a row a port must be out of reach.
_TIMES = 3


def is_cut_off(process: int | str = 'self') -> bool:
    """Whether a process listens at a port that nobody else can open any more.

    Parameters
    ----------
    process : int
        Its number; this one by default.
    """
    folder = Path('/proc') / str(process)
    own: set[str] = set()
    in_reach: dict[str, bool] = {}
    try:
        for descriptor in os.listdir(folder / 'fd'):
            match = _PORT.match(_target(folder / 'fd' / descriptor))
            if match and match[2]:
                own.add(match[1])
        for line in (folder / 'maps').read_text().splitlines():
            match = _PORT.search(line)
            if match and not match[2]:
                in_reach[match[1]] = in_reach.get(match[1], False) or not match[3]
    except OSError:  # no /proc, or no such process
        return False
    return any(not in_reach.get(name, True) for name in own)


def _target(link: Path) -> str:
    try:
        return os.readlink(link)
    except OSError:
        return ''


class Hearing:
    """Looks at this process's ports after it has stood still.

    Parameters
    ----------
    now : callable
        Monotonic time, seconds.
    look : callable
        `is_cut_off`.
    """

    def __init__(
        self,
        now: Callable[[], float] = time.monotonic,
        look: Callable[[], bool] = is_cut_off,
    ) -> None:
        self._now, self._look = now, look
        self._last = now()
        self._until = self._due = float('-inf')
        self._found = 0

    def is_lost(self) -> bool:
        """Whether nothing is heard any more; to be asked several times a second."""
        now = self._now()
        if now - self._last > _PATIENCE:
            self._until, self._found = now + _WATCHED, 0
        self._last = now
        if now > self._until or now < self._due:
            return False
        self._due = now + _PERIOD
        self._found = self._found + 1 if self._look() else 0
        return self._found >= _TIMES
