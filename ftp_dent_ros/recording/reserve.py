"""Room on the disk that is held back for the end.

Its promise: where the disk fills the bag is whole all the same. No library's writer can close a
file on a full disk.
"""

from __future__ import annotations

import errno
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


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
        with suppress(OSError):
            self.hold(0)

    def hold(self, needed: int) -> None:
        """Keep `needed` bytes and some to spare, if the disk has them.

        Raises
        ------
        OSError
            It has no room for what is needed, so that nothing more should be written.
        """
        needed += self._SPARE
        if self._file is None or needed <= self._size:
            return
        # Some file systems cannot reserve anything; that is no reason not to write.
        with suppress(OSError):
            os.posix_fallocate(self._file.fileno(), 0, 2 * needed)
            self._size = 2 * needed
            return
        try:
            os.posix_fallocate(self._file.fileno(), 0, needed)
        except OSError as reason:
            if reason.errno in NO_SPACE:
                raise
        self._size = needed

    def release(self) -> None:
        """Give the room back."""
        if self._file is not None:
            self._file.close()
            self._file = None
