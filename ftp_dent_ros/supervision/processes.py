"""Processes that are started, watched, started again and stopped together."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from ftp_dent_ros.errors import ConfigurationError

# Of util-linux; it replaces itself by the program. (A preexec_fn is not safe beside threads.)
_ENDS_WITH_US = ('setpriv', '--pdeathsig', 'TERM', '--') if shutil.which('setpriv') else ()
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: Seconds that a program is given to end after each signal.
PATIENCE = 5
WRONG_PARAMETERS = 2  # the exit status of a node that cannot use what it was given


@dataclass(frozen=True)
class Program:
    """What is run, and under which name it is spoken of."""

    name: str
    command: tuple[str, ...]


@dataclass(frozen=True)
class RunningProgram:
    """A process of a program, that runs or has ended."""

    program: Program
    process: subprocess.Popen[str]
    reader: threading.Thread
    since: float

    def close(self) -> None:
        """Let go of an ended one's output."""
        # The last lines are worth a moment; a grandchild that keeps the pipe open is not.
        self.reader.join(5.0)
        if self.process.stdout is not None and not self.reader.is_alive():
            self.process.stdout.close()

    def __str__(self) -> str:
        """How it has ended: a negative status is the signal that killed it."""
        status = self.process.returncode
        if status < 0:
            names = {each.value: each.name for each in signal.Signals}
            return f'{self.program.name} was killed by {names.get(-status, -status)}'
        return f'{self.program.name} ended with status {status}'


class Processes(AbstractContextManager['Processes']):
    """Running programs, each in a process group of its own, so that Ctrl-C reaches us alone.

    Leaving the ``with`` block stops all. If this process dies in whatever way, the kernel sends
    SIGTERM to the others (where setpriv is: any usual Linux), so that they end cleanly. It
    watches the thread that started them: start programs from one that lives as long as they
    should.

    Parameters
    ----------
    show : callable
        Called with a program's name and one line of its output, from a thread per program.
    """

    def __init__(self, show: Callable[[str, str], None]) -> None:
        self._show = show
        self._running: dict[str, RunningProgram] = {}
        self._one_ended = threading.Event()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the programs that run, or ended without having been reported yet."""
        return tuple(self._running)

    def start(self, program: Program) -> None:
        """Start a program; no other of its name may be running."""
        if program.name in self._running:
            raise ValueError(f'{program.name} runs already')
        process = subprocess.Popen(
            (*_ENDS_WITH_US, *program.command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, 'PYTHONUNBUFFERED': '1'},
            start_new_session=True,
            text=True,
            errors='replace',
        )
        reader = threading.Thread(
            target=self._read, args=(program, process), name=f'log of {program.name}', daemon=True
        )
        self._running[program.name] = RunningProgram(program, process, reader, time.monotonic())
        reader.start()

    def ended(self, timeout: float = 0.0) -> list[RunningProgram]:
        """Programs that ended by themselves since the last call, waiting for one if need be."""
        self._one_ended.wait(timeout)
        self._one_ended.clear()
        ended = [each for each in self._running.values() if each.process.poll() is not None]
        for each in ended:
            each.close()
            del self._running[each.program.name]
        return ended

    def stop(self, *names: str, patience: float = PATIENCE) -> dict[str, int]:
        """Stop some programs, or all: SIGTERM, again SIGTERM, then SIGKILL.

        Parameters
        ----------
        *names : str
            The programs; all if none is named.
        patience : float
            Seconds that they are given after each signal.

        Returns
        -------
        dict
            Exit status by name of what still ran; -9 for a program that had to be killed.
        """
        chosen = [self._running.pop(name) for name in names or self.names]
        asked = [each for each in chosen if each.process.poll() is None]
        for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGKILL):
            alive = [each for each in asked if each.process.poll() is None]
            for each in alive:
                with suppress(ProcessLookupError):
                    os.killpg(each.process.pid, number)
            deadline = time.monotonic() + patience
            for each in alive:
                with suppress(subprocess.TimeoutExpired):
                    each.process.wait(max(0.0, deadline - time.monotonic()))
        for running in chosen:
            running.close()
        return {each.program.name: each.process.wait() for each in asked}

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _read(self, program: Program, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with suppress(ValueError):  # closed while it was read
            for line in process.stdout:
                # A reader that stops would block the program, so what `show` cannot do is lost.
                with suppress(OSError):
                    self._show(program.name, line.rstrip('\n'))
        process.wait()
        self._one_ended.set()


def respawn_delay(
    status: int, seconds: float, before: float = 0.0, first: float = 1.0
) -> float | None:
    """When a process that has ended is restarted: however it ends, but not with wrong parameters.

    What ran for longer than ten seconds is restarted at once: it had what it needed, and the
    flight goes on without it meanwhile. What ends sooner waits, twice as long each time, up to
    half a minute.

    Parameters
    ----------
    status : int
    seconds : float
        That it ran for.
    before, first : float
        The delay of its last restart, and that of the first of several.

    Returns
    -------
    float or None
        Seconds; None if it is not started again, for it would end in the same way.
    """
    if status == WRONG_PARAMETERS:
        return None
    if seconds > 10.0:
        return 0.0
    return min(2.0 * before, 30.0) if before else first


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
    first_delay: float = 1.0,
) -> int:
    """Start programs, restart those that end, until `stopping` or none is left.

    Returns
    -------
    int
        0, or 2 if a program ended with that status: it is not started again.
    """
    # When to start, on the monotonic clock.
    due = dict.fromkeys(programs, 0.0)
    delays: dict[Program, float] = {}
    status = 0
    while not stopping():
        for program in [each for each, when in due.items() if when <= time.monotonic()]:
            del due[program]
            processes.start(program)
        for end in processes.ended(timeout=0.2):
            before = delays.get(end.program, 0.0)
            seconds = time.monotonic() - end.since
            delay = respawn_delay(end.process.returncode, seconds, before, first_delay)
            say(f'{end}: {verdict(delay)}')
            if delay is None:
                status = WRONG_PARAMETERS
            else:
                delays[end.program] = delay
                due[end.program] = time.monotonic() + delay
        if not due and not processes.names:
            say('no node is left to run')
            return status
    say('stopping')
    for name, code in processes.stop().items():
        if code == -signal.SIGKILL:
            say(f'{name} did not end when asked to, and was killed')
    say('stopped')
    return status


class ProcessLog(AbstractContextManager['ProcessLog']):
    """Lines of several programs on one terminal, each behind its program's name.

    Parameters
    ----------
    names : sequence of str
        The programs.
    folder : Path, optional
        Where each program's lines are also written, as NAME.log.
    terminal : text file, optional
        Standard output by default.
    """

    def __init__(
        self, names: Sequence[str], folder: Path | None = None, terminal: TextIO | None = None
    ) -> None:
        self._terminal = terminal or sys.stdout
        self._width = max(map(len, (*names, 'up')))
        self._lock = threading.Lock()
        self._files: dict[str, TextIO] = {}
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                for name in names:
                    path = folder / f'{name.replace("/", ".")}.log'
                    self._files[name] = path.open('a', encoding='utf-8')
            except OSError as error:
                raise ConfigurationError(
                    f'{folder}: no log can be written there ({error.strerror}): choose another'
                ) from None

    def show(self, name: str, line: str) -> None:
        """Print one line of a program."""
        with self._lock:
            if name in self._files:
                print(line, file=self._files[name], flush=True)
            try:
                print(f'{name:>{self._width}} | {line}', file=self._terminal, flush=True)
            except OSError:
                # Whoever read it has gone; the programs go on, and so do the files.
                with open(os.devnull, 'w') as nowhere:
                    os.dup2(nowhere.fileno(), self._terminal.fileno())

    def say(self, line: str) -> None:
        """Print a line of our own."""
        self.show('up', line)

    def __exit__(self, *_: object) -> None:
        for file in self._files.values():
            file.close()


@contextmanager
def stop_event_meanwhile() -> Iterator[threading.Event]:
    """As `stop_event`, until the end of the ``with`` block."""
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield stop_event()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def stop_event() -> threading.Event:
    """Event that SIGINT, SIGTERM and SIGHUP set from now on, however often they come.

    To be called in the main thread. SIGHUP is a closed terminal or a lost ssh connection; one
    that `nohup` lets be ignored stays ignored.
    """
    stop = threading.Event()

    def hear(*_: object) -> None:
        # In a thread: where the signal comes, `wait` or `set` may hold the event's lock.
        if not stop.is_set():
            threading.Thread(target=stop.set).start()

    for number in _SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, hear)
    return stop


def ignore_signals() -> None:
    """Ignore what `stop_event` hears: Python's own end would let it kill the process."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
