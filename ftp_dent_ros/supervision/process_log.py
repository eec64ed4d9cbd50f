"""The output of several programs, on one terminal and in files."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from ftp_dent_ros.errors import ConfigurationError

COLOURS = (36, 32, 33, 35, 34, 96, 92, 93)


class ProcessLog:
    """Lines of several programs on one terminal, each behind its program's name.

    Parameters
    ----------
    names : sequence of str
        The programs.
    folder : Path, optional
        Where each program's lines are also written, as NAME.log.
    terminal : text file, optional
        Standard output by default; the names are coloured where it is a terminal.
    """

    def __init__(
        self, names: Sequence[str], folder: Path | None = None, terminal: TextIO | None = None
    ) -> None:
        self._terminal = terminal or sys.stdout
        self.coloured = self._terminal.isatty()
        self._width = max(map(len, (*names, 'up')))
        self._colour = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
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
        label = f'{name:>{self._width}} |'
        if self.coloured:
            label = f'\033[{self._colour.get(name, 1)}m{label}\033[0m'
        with self._lock:
            if name in self._files:
                print(line, file=self._files[name], flush=True)
            try:
                print(label, line, file=self._terminal, flush=True)
            except OSError:
                # Whoever read it has gone; the programs go on, and so do the files.
                with open(os.devnull, 'w') as nowhere:
                    os.dup2(nowhere.fileno(), self._terminal.fileno())

    def say(self, line: str) -> None:
        """Print a line of our own."""
        self.show('up', line)

    def __enter__(self) -> ProcessLog:
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._files.values():
            file.close()
