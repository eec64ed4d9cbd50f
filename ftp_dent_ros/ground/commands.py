"""Commands to the drone: each done once, each answered, or said to have failed."""

from __future__ import annotations

import json
import secrets
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ftp_dent_ros.ground.link import GroundLink
from ftp_dent_ros.ground.protocol import remember
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


class Answer(NamedTuple):
    """What became of a command: whether it was done, and a sentence or what was asked for."""

    success: bool
    message: str

    def pack(self) -> bytes:
        """JSON of it."""
        return json.dumps(self._asdict()).encode()


class Executive:
    """On the drone: does each command once, however often it is heard.

    Parameters
    ----------
    does : mapping
        What is done for each name of `COMMANDS`, all in one thread that lives as long as this.
    """

    def __init__(self, does: Mapping[str, Callable[[], Answer]]) -> None:
        self._does = does
        self._answers: dict[str, Answer] = {}
        self._thread = ThreadPoolExecutor(1, 'commands')

    def reply(self, request: bytes) -> bytes:
        """Answer to a request, whatever it holds."""
        name, _, key = request[:100].decode(errors='replace').partition(' ')
        if name not in COMMANDS or len(key) != 32:
            return Answer(False, 'this is no command: it is refused').pack()
        if name not in self._does:
            return Answer(False, f'this payload cannot {COMMANDS[name]}').pack()
        return self._thread.submit(self._do, name, key).result().pack()

    def _do(self, name: str, key: str) -> Answer:
        if key not in self._answers:
            remember(self._answers, key, self._does[name](), 64)
        return self._answers[key]


def give_command(link: GroundLink, name: str, patience: float = 20.0) -> Answer:
    """On the ground: give a command, again if need be, and say what became of it."""
    request = f'{name} {secrets.token_hex(16)}'.encode()
    end = time.monotonic() + patience
    while (left := end - time.monotonic()) > 0:
        reply = link.ask(CHANNEL, request, min(left, 4.0))
        if reply is not None:
            # Whoever is in the link may have answered anything.
            with suppress(ValueError, KeyError, TypeError, RecursionError):
                given = json.loads(reply)
                return Answer(bool(given['success']), str(given['message']))
        time.sleep(min(0.2, left))
    return Answer(
        False,
        f'no answer from the drone within {patience:g} s: whether it did {COMMANDS[name]} is not '
        'known',
    )


class Recordings:
    """Runs ``ftp-dent record --all`` as a process, one at a time.

    The process ends with the thread that started it (see `Processes`): an `Executive`'s, say.

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
        self._processes = Processes(self._show)

    @property
    def state(self) -> str:
        """What is recorded, for people."""
        return f'recording to {self._bag}' if self._bag else 'not recording'

    def start(self) -> Answer:
        """Begin a recording of all topics."""
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

    def stop(self) -> Answer:
        """End the recording."""
        self._notice_end()
        if self._bag is None:
            return Answer(False, 'nothing is being recorded')
        bag, self._bag = self._bag, None
        status = self._processes.stop('recorder').get('recorder', 0)
        if status:
            return Answer(False, f'the recording {bag} ended with an error: {self._last}')
        return Answer(True, f'recorded {self._last or bag}')

    def close(self) -> None:
        """End the recording, if there is one."""
        self._processes.stop()

    def _show(self, _: str, line: str) -> None:
        self._last = line
        self._say(line)

    def _notice_end(self) -> None:
        if self._processes.ended(0.0):
            self._bag = None
