"""What has not been delivered yet: on disk, bounded, and still there after a restart."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground.protocol import LARGEST_ITEM, REPLACED, Importance, Item, Name


@dataclass(eq=False)
class Kept:
    """An item that is kept.

    Attributes
    ----------
    name : Name
    importance : Importance
    stamp_ns : int
    topic : str
        '' for one that was found on disk.
    size : int
        Bytes.
    latest : bool
    owed : set of bytes
        Grounds that it is promised to and that have not got it.
    begun, gone : bool
        Whether some of it has been sent, and whether it is kept no longer.
    """

    name: Name
    importance: Importance
    stamp_ns: int
    topic: str
    size: int
    latest: bool = False
    owed: set[bytes] = field(default_factory=set)
    begun: bool = False
    gone: bool = False

    @property
    def is_replaced(self) -> bool:
        """Whether the next one of its topic takes its place."""
        return self.latest or self.importance in REPLACED


class Store:
    """Items by name, the least important and oldest dropped when there is no room.

    State, previews and lists are kept in memory alone: another start has newer ones.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps all in memory.
    limit : int
        Bytes of all items.
    boot : int
        Of this program's start.

    Attributes
    ----------
    dropped : int
        Items that were given up.
    unwritten : int
        Items that are in memory alone, for the disk is full.

    Raises
    ------
    ConfigurationError
        The folder cannot be written.
    """

    def __init__(self, folder: Path | None, limit: int, boot: int) -> None:
        self.dropped = self.unwritten = self.size = 0
        self.boot = boot
        self._folder = folder
        self._limit = limit
        self._number = 0
        self._kept: dict[Name, Kept] = {}
        # What is not on disk.
        self._memory: dict[Name, bytes] = {}
        self._lock = threading.RLock()
        if folder is None:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as reason:
            raise ConfigurationError(
                f'{folder}: cannot keep items there ({reason.strerror}): choose another folder'
            ) from None
        for path in sorted(folder.iterdir()):
            self._find(path)

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Kept]:
        with self._lock:
            return iter(list(self._kept.values()))

    def put(self, item: Item) -> Kept:
        """Keep an item, and drop what it takes the place of."""
        data = item.pack()
        with self._lock:
            self._number += 1
            name = Name(self.boot, self._number)
            kept = Kept(name, item.importance, item.stamp_ns, item.topic, len(data), item.latest)
            if kept.is_replaced:
                for other in self:
                    if other.topic == item.topic and not other.begun:
                        self.remove(other)
            self._kept[name] = kept
            self._memory[name] = data
            self.size += kept.size
        if self._folder is not None and not kept.is_replaced:
            self._write(kept, data)
        with self._lock:
            while self.size > self._limit and len(self._kept) > 1:
                # The least important, of these the oldest.
                self.remove(max(self._kept.values(), key=lambda k: (k.importance, -k.stamp_ns)))
                self.dropped += 1
        return kept

    def read(self, kept: Kept) -> bytes | None:
        """Bytes of an item, or None if it is no longer there."""
        data = self._memory.get(kept.name)
        if data is not None or kept.gone:
            return data
        try:
            data = self._path(kept).read_bytes()
            Item.unpack(data)
        except (OSError, CodecError):
            self.remove(kept)
            self.dropped += 1
            return None
        return data

    def remove(self, kept: Kept) -> None:
        """Forget an item that is delivered or of no more use."""
        with self._lock:
            if self._kept.pop(kept.name, None) is None:
                return
            kept.gone = True
            self.size -= kept.size
            is_on_disk = self._memory.pop(kept.name, None) is None
        if is_on_disk:
            with contextlib.suppress(OSError):
                self._path(kept).unlink(missing_ok=True)

    def waiting(self, importance: Importance) -> int:
        """How many items of an importance are kept."""
        return sum(kept.importance == importance for kept in self)

    def _path(self, kept: Kept) -> Path:
        assert self._folder is not None
        stem = f'{int(kept.importance)}_{kept.stamp_ns}_{kept.name.boot:x}_{kept.name.number}'
        return self._folder / f'{stem}.item'

    def _write(self, kept: Kept, data: bytes) -> None:
        """Write an item; if the disk is full it stays in memory as long as there is room."""
        path = self._path(kept)
        aside = path.with_suffix('.part')
        try:
            aside.write_bytes(data)
            os.replace(aside, path)
        except OSError:
            self.unwritten += 1
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            return
        with self._lock:
            if self._memory.pop(kept.name, None) is None:  # removed meanwhile
                path.unlink(missing_ok=True)

    def _find(self, path: Path) -> None:
        """Take up a file of an earlier start; halves and strangers' are left out."""
        match = re.fullmatch(r'([0-5])_(\d+)_([0-9a-f]+)_(\d+)\.item', path.name)
        if path.suffix == '.part':
            path.unlink(missing_ok=True)
        size = path.stat().st_size if match else 0
        if match is None or size > LARGEST_ITEM:
            return
        name = Name(int(match[3], 16), int(match[4]))
        self._kept[name] = Kept(name, Importance(int(match[1])), int(match[2]), '', size)
        self.size += size
