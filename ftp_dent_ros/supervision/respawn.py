"""Which processes are started again, and when: of ``ftp-dent up`` and ``ros2 launch`` alike."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence

from ftp_dent_ros.supervision.processes import Processes, Program
from ftp_dent_ros.supervision.shared_memory import free_leftovers

WRONG_PARAMETERS = 2  # the exit status of a node that cannot use what it was given
# Seconds. A camera that is plugged in again is there within seconds; what lacks something ends in
# its first seconds, and a process that has run for longer had what it needed.
FIRST_DELAY, _LONGEST_DELAY, _SETTLED = 1.0, 30.0, 10.0


class Respawn:
    """Policy for one process: restarted however it ends, but not with wrong parameters.

    What ran for longer than ten seconds is restarted at once: it had what it needed, and the
    flight goes on without it meanwhile. What ends sooner waits, twice as long each time.
    """

    def __init__(self, first_delay: float = FIRST_DELAY) -> None:
        self._first = self._next = first_delay

    def delay(self, status: int, seconds: float) -> float | None:
        """Seconds until a process that ended after running for `seconds` is started again.

        Returns
        -------
        float or None
            None if it is not: it would end in the same way.
        """
        if status == WRONG_PARAMETERS:
            return None
        if seconds > _SETTLED:
            self._next = self._first
            return 0.0
        delay, self._next = self._next, min(2.0 * self._next, _LONGEST_DELAY)
        return delay


def verdict(delay: float | None) -> str:
    """What to say of a process that has ended."""
    if delay is None:
        return 'it cannot run with what it was given, so it is not restarted'
    return f'restarting it in {delay:g} s' if delay else 'restarting it at once'


def keep_running(
    programs: Sequence[Program],
    processes: Processes,
    say: Callable[[str], None],
    stopping: Callable[[], bool],
    first_delay: float = FIRST_DELAY,
) -> int:
    """Start programs that do not run, restart those that end, until `stopping` or none is left.

    Returns
    -------
    int
        0, or 2 if a program ended with that status: it is not started again.
    """
    # When to start, on the monotonic clock.
    due = dict.fromkeys((each for each in programs if each.name not in processes.names), 0.0)
    respawns = {program: Respawn(first_delay) for program in programs}
    status = 0
    while not stopping():
        for program in [each for each, when in due.items() if when <= time.monotonic()]:
            del due[program]
            # A killed process leaves its segments, which others could not have in its place.
            free_leftovers()
            processes.start(program)
        for end in processes.ended(timeout=0.2):
            delay = respawns[end.program].delay(end.status, end.seconds)
            say(f'{end}: {verdict(delay)}')
            if delay is None:
                status = WRONG_PARAMETERS
            else:
                due[end.program] = time.monotonic() + delay
        if not due and not processes.names:
            say('no node is left to run')
            return status
    say('stopping')
    for name, code in processes.stop().items():
        if code == -signal.SIGKILL:
            say(f'{name} did not end when asked to, and was killed')
    free_leftovers()
    say('stopped')
    return status
