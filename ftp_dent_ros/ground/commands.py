"""Commands to the drone: each done once, each answered, or said to have failed."""

from __future__ import annotations

import json
import secrets
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.supervision.processes import Processes, Program

COMMANDS = {
    'capture': 'take a photograph',
    'start_recording': 'start a recording',
    'stop_recording': 'end the recording',
    'take_list': 'take the list of dents',
}
CHANNEL = 'command'
# Seconds within which a recorder begins, also on a small computer that is busy.
_BEGIN = 45.0


@dataclass(frozen=True)
class Answer:
    """What became of a command: whether it was done, and a sentence or what was asked for."""

    success: bool
    message: str


class Executive:
    """On the drone: does each command once, however often it is heard.

    Parameters
    ----------
    does : mapping
        What is done for each name of `COMMANDS`.
    """

    def __init__(self, does: Mapping[str, Callable[[], Answer]]) -> None:
        self.refused = 0
        self._does = does
        self._answers: OrderedDict[str, Answer] = OrderedDict()
        self._lock = threading.Lock()

    def reply(self, request: bytes) -> bytes:
        """Answer to a request, whatever it holds."""
        answer = self._answer(request)
        return json.dumps({'success': answer.success, 'message': answer.message}).encode()

    def _answer(self, request: bytes) -> Answer:
        try:
            if len(request) > 4096:
                raise ValueError
            given = json.loads(request)
            name, key = given['command'], given['id']
            if name not in COMMANDS or not isinstance(key, str) or len(key) != 32:
                raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            self.refused += 1
            return Answer(False, 'this is no command: it is refused')
        if name not in self._does:
            return Answer(False, f'this payload cannot {COMMANDS[name]}')
        with self._lock:  # one after another
            if key not in self._answers:
                self._answers[key] = self._does[name]()
                if len(self._answers) > 64:  # who asks again is given the same answer
                    self._answers.popitem(last=False)
            return self._answers[key]


def give_command(link: GroundLink, name: str, patience: float = 20.0) -> Answer:
    """On the ground: give a command, again if need be, and say what became of it."""
    request = json.dumps({'command': name, 'id': secrets.token_hex(16)}).encode()
    end = time.monotonic() + patience
    while (left := end - time.monotonic()) > 0:
        reply = link.ask(CHANNEL, request, min(left, 4.0))
        if reply is None:
            time.sleep(min(0.2, max(0.0, end - time.monotonic())))
            continue
        try:
            given = json.loads(reply)
            return Answer(bool(given['success']), str(given['message']))
        except (ValueError, KeyError, TypeError, RecursionError):
            break
    return Answer(
        False,
        f'no answer from the drone within {patience:g} s: whether it did {COMMANDS[name]} is not '
        'known',
    )


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
        # Processes end with the thread that started them: it must live as long as this object.
        self._thread = ThreadPoolExecutor(1, 'recordings')
        self._processes = Processes(self._show)

    @property
    def state(self) -> str:
        """What is recorded, for people."""
        return f'recording to {self._bag}' if self._bag else 'not recording'

    def start(self) -> Answer:
        """Begin a recording of all topics."""
        return self._thread.submit(self._start).result()

    def stop(self) -> Answer:
        """End the recording."""
        return self._thread.submit(self._stop).result()

    def close(self) -> None:
        """End the recording, if there is one, and the thread."""
        self._thread.submit(self._processes.stop)
        self._thread.shutdown()

    def _show(self, _: str, line: str) -> None:
        self._last = line
        self._say(line)

    def _start(self) -> Answer:
        self._notice_end()
        if self._bag is not None:
            return Answer(False, f'a recording runs already: {self._bag}')
        bag = self._folder / time.strftime('rosbag2_%Y_%m_%d-%H_%M_%S')
        words = ('-m', 'ftp_dent_ros.cli.main', 'record', '--all', '--output', str(bag))
        self._processes.start(Program('recorder', (sys.executable, *words)))
        end = time.monotonic() + _BEGIN
        while not bag.is_dir():
            if self._processes.ended(0.1):
                return Answer(False, f'the recording could not begin: {self._last}')
            if time.monotonic() > end:
                self._processes.stop('recorder')
                return Answer(False, f'the recording did not begin within {_BEGIN:.0f} s')
        self._bag = bag
        return Answer(True, f'recording to {bag}')

    def _stop(self) -> Answer:
        self._notice_end()
        if self._bag is None:
            return Answer(False, 'nothing is being recorded')
        bag, self._bag = self._bag, None
        status = self._processes.stop('recorder').get('recorder', 0)
        if status:
            return Answer(False, f'the recording {bag} ended with an error: {self._last}')
        return Answer(True, f'recorded {self._last or bag}')

    def _notice_end(self) -> None:
        if self._processes.ended(0.0):
            self._bag = None
