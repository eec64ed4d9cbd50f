"""Processes that are started, watched and stopped together."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType

from ftp_dent_ros.supervision.gate import Gate

# Of util-linux; it replaces itself by the program. (A preexec_fn is not safe beside threads.)
_ENDS_WITH_US = ('setpriv', '--pdeathsig', 'TERM', '--') if shutil.which('setpriv') else ()


# For the output of what has ended; a busy machine takes that long to read it, seconds.
_LAST_LINES = 5.0


@dataclass(frozen=True)
class Program:
    """What is run, and under which name it is spoken of."""

    name: str
    command: tuple[str, ...]


@dataclass(frozen=True)
class Ended:
    """A process that ended by itself; a negative status is the signal that killed it."""

    program: Program
    status: int
    seconds: float

    def __str__(self) -> str:
        if self.status < 0:
            names = {each.value: each.name for each in signal.Signals}
            return f'{self.program.name} was killed by {names.get(-self.status, -self.status)}'
        return f'{self.program.name} ended with status {self.status}'


class Processes:
    """Running programs, each in a process group of its own, so that Ctrl-C reaches us alone.

    Leaving the ``with`` block stops all. If this process dies in whatever way, the kernel sends
    SIGTERM to the others (where setpriv is: any usual Linux), so that they end cleanly and give
    their shared memory back. It watches the thread that started them: start programs from one
    that lives as long as they should.

    Parameters
    ----------
    show : callable
        Called with a program's name and one line of its output, from a thread per program.
    environment : mapping, optional
        Variables that are added to this process's own.
    """

    def __init__(
        self, show: Callable[[str, str], None], environment: Mapping[str, str] | None = None
    ) -> None:
        self._show = show
        self._environment = {'PYTHONUNBUFFERED': '1', **(environment or {})}
        self._running: dict[str, _Running] = {}
        self._one_ended = threading.Event()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the programs that run, or ended without having been reported yet."""
        return tuple(self._running)

    def pid(self, name: str) -> int:
        """Process id of a program in `names`."""
        return self._running[name].process.pid

    def add(self, environment: Mapping[str, str]) -> None:
        """Add variables for the programs that are started from now on."""
        self._environment.update(environment)

    def start(self, program: Program, gate: Gate | None = None) -> None:
        """Start a program, before a gate if one is given; no other of its name may be running."""
        if program.name in self._running:
            raise ValueError(f'{program.name} runs already')
        process = subprocess.Popen(
            (*_ENDS_WITH_US, *program.command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, **self._environment, **(gate.variables if gate else {})},
            pass_fds=(gate.descriptor,) if gate else (),
            start_new_session=True,
            text=True,
            errors='replace',
        )
        reader = threading.Thread(
            target=self._read, args=(program, process), name=f'log of {program.name}', daemon=True
        )
        self._running[program.name] = _Running(program, process, reader, time.monotonic())
        reader.start()

    def ended(self, timeout: float = 0.0) -> list[Ended]:
        """Programs that ended by themselves since the last call, waiting for one if need be."""
        self._one_ended.wait(timeout)
        self._one_ended.clear()
        reports = []
        for name, running in list(self._running.items()):
            status = running.process.poll()
            if status is not None:
                seconds = time.monotonic() - running.since
                running.close()
                del self._running[name]
                reports.append(Ended(running.program, status, seconds))
        return reports

    def stop(self, *names: str, patience: float = 5.0) -> dict[str, int]:
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

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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


@dataclass(frozen=True)
class _Running:
    program: Program
    process: subprocess.Popen[str]
    reader: threading.Thread
    since: float

    def close(self) -> None:
        # The last lines are worth a moment; a grandchild that keeps the pipe open is not.
        self.reader.join(_LAST_LINES)
        if self.process.stdout is not None and not self.reader.is_alive():
            self.process.stdout.close()
