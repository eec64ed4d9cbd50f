"""Commands to the drone: each done once, each answered, or told as failed."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ftp_dent_ros.ground.link import Link

COMMANDS = {
    'capture': 'take a photograph',
    'start_recording': 'start a recording',
    'stop_recording': 'end the recording',
    'take_list': 'take the list of dents',
}
WAY = 'command'
# Answers that are given again to who asks again, and bytes of a request at most.
_REMEMBERED = 64
_LARGEST = 4096
# A try, and all of them, seconds.
_TRY, _PATIENCE = 4.0, 20.0


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
            if len(request) > _LARGEST:
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
                while len(self._answers) > _REMEMBERED:
                    self._answers.popitem(last=False)
            return self._answers[key]


def command(link: Link, name: str, patience: float = _PATIENCE) -> Answer:
    """On the ground: give a command, again if need be, and say what became of it."""
    request = json.dumps({'command': name, 'id': secrets.token_hex(16)}).encode()
    end = time.monotonic() + patience
    while (left := end - time.monotonic()) > 0:
        reply = link.ask(WAY, request, min(left, _TRY))
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
