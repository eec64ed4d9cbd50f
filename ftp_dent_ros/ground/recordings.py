"""Recordings on the drone that the ground starts and ends."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from ftp_dent_ros.ground.commands import Answer
from ftp_dent_ros.supervision.processes import Processes, Program

_NAME = 'recorder'
# Seconds within which a recorder begins, also on a small computer that is busy.
_BEGIN = 45.0


class Recordings:
    """Runs ``ftp-dent record --all`` as a process, one at a time.

    Parameters
    ----------
    folder : Path
        Of the bags, each named by the time it was begun.
    say : callable
        Called with each line that the recorder prints.
    """

    def __init__(self, folder: Path, say: Callable[[str], None]) -> None:
        self._folder = folder
        self._bag: Path | None = None
        self._last = ''
        self._say = say
        self._work: queue.Queue[tuple[Callable[[], Answer], queue.Queue[Answer]] | None]
        self._work = queue.Queue()
        # Processes end with the thread that started them: it must live as long as this object.
        self._thread = threading.Thread(target=self._run, name='recordings', daemon=True)
        self._thread.start()

    @property
    def state(self) -> str:
        """What is recorded, for people."""
        return f'recording to {self._bag}' if self._bag else 'not recording'

    def start(self) -> Answer:
        """Begin a recording of all topics."""
        return self._do(self._start)

    def stop(self) -> Answer:
        """End the recording."""
        return self._do(self._stop)

    def close(self) -> None:
        """End the recording, if there is one, and the thread."""
        self._work.put(None)
        self._thread.join(15.0)

    def _do(self, work: Callable[[], Answer]) -> Answer:
        answer: queue.Queue[Answer] = queue.Queue()
        self._work.put((work, answer))
        return answer.get()

    def _run(self) -> None:
        with Processes(self._show) as self._processes:
            while (task := self._work.get()) is not None:
                work, answer = task
                answer.put(work())

    def _show(self, _: str, line: str) -> None:
        self._last = line
        self._say(line)

    def _start(self) -> Answer:
        self._notice_end()
        if self._bag is not None:
            return Answer(False, f'a recording runs already: {self._bag}')
        bag = self._folder / time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
        words = ('-m', 'ftp_dent_ros.cli.main', 'record', '--all', '--output', str(bag))
        self._processes.start(Program(_NAME, (sys.executable, *words)))
        end = time.monotonic() + _BEGIN
        while not bag.is_dir():
            if self._processes.ended(0.1):
                return Answer(False, f'the recording could not begin: {self._last}')
            if time.monotonic() > end:
                self._processes.stop(_NAME)
                return Answer(False, f'the recording did not begin within {_BEGIN:.0f} s')
        self._bag = bag
        return Answer(True, f'recording to {bag}')

    def _stop(self) -> Answer:
        self._notice_end()
        if self._bag is None:
            return Answer(False, 'nothing is being recorded')
        bag, self._bag = self._bag, None
        status = self._processes.stop(_NAME).get(_NAME, 0)
        if status:
            return Answer(False, f'the recording {bag} ended with an error: {self._last}')
        return Answer(True, f'recorded {self._last or bag}')

    def _notice_end(self) -> None:
        if self._processes.ended(0.0):
            self._bag = None
