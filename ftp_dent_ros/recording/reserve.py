"""Room on the disk that is held back for the end."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import IO


class Reserve:
    """Room on the disk for a bag's summary and metadata, so that a full disk can be closed on.

    A file without a name: it goes when the process goes, however it goes.
    """

    _SPARE = 1 << 16

    def __init__(self, folder: Path) -> None:
        self._size = 0
        try:
            self._file: IO[bytes] | None = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        except OSError:
            self._file = None
        self.hold(0)

    def hold(self, needed: int) -> None:
        """Keep `needed` bytes and some to spare, if the disk has them."""
        needed += self._SPARE
        if self._file is None or needed <= self._size:
            return
        try:
            os.posix_fallocate(self._file.fileno(), 0, 2 * needed)
        except OSError:
            return
        self._size = 2 * needed

    def release(self) -> None:
        """Give the room back."""
        if self._file is not None:
            self._file.close()
            self._file = None
