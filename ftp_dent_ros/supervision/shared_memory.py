"""Shared memory of Fast DDS: what killed processes left behind, and how much is free.

Each segment is a file ``fastrtps_HEX`` of the size that its participant may need, each port a
file ``fastrtps_portN``; beside it lies a file that its owner keeps locked (``_el``; ``_sl`` of a
port that several listen on). A process that is killed leaves the files, and the kernel opens
their locks: what can be locked belongs to nobody.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

FOLDER = '/dev/shm'
_LOCK = re.compile(r'(fastrtps_(?:[0-9a-f]{16}|port\d+))_(?:el|sl)')
# A participant that is just starting has made its lock's file, and not yet locked it; seconds.
_YOUNG = 5.0


@dataclass(frozen=True)
class Freed:
    """How many segments and bytes were given back."""

    segments: int
    bytes: int


def free_leftovers(folder: str | os.PathLike[str] = FOLDER) -> Freed:
    """Remove the segments and ports that no living process owns; others' files stay.

    Parameters
    ----------
    folder : path
        Where Fast DDS keeps them.
    """
    stems = sorted({match[1] for match in map(_LOCK.fullmatch, _names(folder)) if match})
    segments = freed = 0
    for stem in stems:
        path = Path(folder) / stem
        locks = [path.with_name(f'{stem}{suffix}') for suffix in ('_el', '_sl')]
        present = [lock for lock in locks if lock.exists()]
        # Not permitted, or gone in the meantime: another user's, or another cleaner's.
        with suppress(OSError), _held(present) as is_ours:
            if not is_ours:
                continue
            size = path.stat().st_size if path.exists() else 0
            for each in (path, path.with_name(f'sem.{stem}_mutex'), *present):
                each.unlink(missing_ok=True)
            freed += size
            segments += 'port' not in stem
    return Freed(segments, freed)


@contextmanager
def _held(locks: list[Path]) -> Iterator[bool]:
    """Hold the locks meanwhile; whether nobody else holds one of them."""
    descriptors: list[int] = []
    try:
        for lock in locks:
            descriptors.append(os.open(lock, os.O_RDWR | os.O_CLOEXEC))
            if time.time() - os.fstat(descriptors[-1]).st_mtime < _YOUNG:
                yield False
                return
            try:
                fcntl.flock(descriptors[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
                return
        yield bool(locks)
    finally:
        for descriptor in descriptors:
            os.close(descriptor)


def free_bytes(folder: str | os.PathLike[str] = FOLDER) -> int:
    """Bytes that may still be written in a file system; 0 if it is not there."""
    try:
        status = os.statvfs(folder)
    except OSError:
        return 0
    return status.f_bavail * status.f_frsize


def _names(folder: str | os.PathLike[str]) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []
