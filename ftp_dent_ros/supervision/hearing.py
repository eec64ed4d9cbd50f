"""Whether this process still hears what others send through the shared memory of Fast DDS.

A process that is killed or stands still for a second is given up: those that send to it make its
port anew, again and again, and so does the process when it goes on or is started again. When both
do that at the same moment, the file of the one takes the place of the other's, and the process
listens for good where nobody can reach it.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from pathlib import Path

from ftp_dent_ros.supervision.shared_memory import FOLDER

_LOCK = re.compile(re.escape(FOLDER) + r'/(fastrtps_port\d+)_el')
_MAPPED = re.compile(re.escape(FOLDER) + r'/(fastrtps_port\d+)( \(deleted\))?$', re.MULTILINE)
# Seconds between two looks, and in how many of them in a row a port must be out of reach: one
# that is being made anew is so for a moment.
_PERIOD, _TIMES = 1.0, 3


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
            if match := _LOCK.match(_target(folder / 'fd' / descriptor)):
                own.add(match[1])
        for name, is_deleted in _MAPPED.findall((folder / 'maps').read_text()):
            in_reach[name] = in_reach.get(name, False) or not is_deleted
    except OSError:  # no /proc, or no such process
        return False
    return any(not in_reach.get(name, True) for name in own)


def _target(link: Path) -> str:
    try:
        return os.readlink(link)
    except OSError:
        return ''


def ports() -> frozenset[tuple[str, int]]:
    """Names and inodes of the files of all ports on this computer."""
    try:
        with os.scandir(FOLDER) as entries:
            return frozenset(
                (entry.name, entry.inode())
                for entry in entries
                if entry.name.startswith('fastrtps_port')
            )
    except OSError:
        return frozenset()


class Hearing:
    """Looks at this process's ports now and then.

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
        self._due = now() + _PERIOD
        self._found = 0
        # As they were when this process was in reach: while they are so, it is.
        self._well: frozenset[tuple[str, int]] | None = None

    def is_lost(self) -> bool:
        """Whether nothing is heard any more; to be asked several times a second."""
        now = self._now()
        if now < self._due:
            return False
        self._due = now + _PERIOD
        before = ports()
        if before == self._well:
            self._found = 0
        elif self._look():
            self._found += 1
        else:
            self._found, self._well = 0, before
        return self._found >= _TIMES
