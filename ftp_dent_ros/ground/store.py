"""What has not been delivered yet: on disk, bounded, and still there after a restart."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import threading
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground.protocol import LARGEST_ITEM, REPLACED, Importance, Item, Name

_NAME = re.compile(r'(\d)_(\d+)_([0-9a-f]+)_(\d+)\.item')
_CACHE = 16 << 20  # bytes of items kept in memory too
_FULL = (errno.ENOSPC, errno.EDQUOT)
_BLOCK = 4096  # bytes that a file takes at least


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
        Grounds that have not got it.
    claimed : bool
        Whether any ground has been promised it; who comes first gets what is not.
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
    claimed: bool = False
    begun: bool = False
    gone: bool = False

    @property
    def passing(self) -> bool:
        """Whether the next one of its topic takes its place."""
        return self.latest or self.importance in REPLACED


class Store:
    """Items by name, the least important and oldest dropped when there is no room.

    On a full disk `unwritten` counts what is in memory alone.

    State, previews and lists are kept in memory alone: another start has newer ones.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps all in memory.
    limit : int
        Bytes of all items.
    boot : int
        Of this program's start.

    Raises
    ------
    ConfigurationError
        The folder cannot be written.
    """

    def __init__(self, folder: Path | None, limit: int, boot: int) -> None:
        self.dropped = 0
        self.unwritten = 0
        self.size = 0
        self._folder = folder
        self._limit = limit
        self.boot = boot
        self._number = 0
        self._kept: dict[Name, Kept] = {}
        self._memory: OrderedDict[Name, bytes] = OrderedDict()
        self._memory_size = 0
        self._lock = threading.RLock()
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                probe = folder / '.probe'
                probe.write_bytes(b'')
                probe.unlink()
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
            if item.latest or item.importance in REPLACED:
                for other in list(self._kept.values()):
                    if other.topic == item.topic and not other.begun:
                        self.remove(other)
            self._kept[name] = kept
            self.size += kept.size
            self._remember(name, data)
        if self._folder is not None and not kept.passing:
            self._write(kept, data)
        self._make_room()
        return kept

    def read(self, kept: Kept) -> bytes | None:
        """Bytes of an item, or None if it is no longer there."""
        with self._lock:
            data = self._memory.get(kept.name)
            if data is not None or kept.name not in self._kept:
                return data
        try:
            data = self._path(kept).read_bytes() if self._folder is not None else None
            if data is not None:
                Item.unpack(data)
        except (OSError, CodecError):
            data = None
        with self._lock:
            if data is None:
                self.remove(kept)
                self.dropped += 1
            else:
                self._remember(kept.name, data)
        return data

    def remove(self, kept: Kept) -> None:
        """Forget an item that is delivered or of no more use."""
        with self._lock:
            if self._kept.pop(kept.name, None) is None:
                return
            kept.gone = True
            self.size -= kept.size
            self._memory_size -= len(self._memory.pop(kept.name, b''))
        if self._folder is not None and not kept.passing:
            with contextlib.suppress(OSError):
                self._path(kept).unlink(missing_ok=True)

    def waiting(self, importance: Importance) -> int:
        """How many items of an importance are kept."""
        with self._lock:
            return sum(kept.importance == importance for kept in self._kept.values())

    def _make_room(self) -> None:
        with self._lock:
            while self.size > self._limit and len(self._kept) > 1:
                self.remove(max(self._kept.values(), key=_order))
                self.dropped += 1

    def _remember(self, name: Name, data: bytes) -> None:
        self._memory[name] = data
        self._memory.move_to_end(name)
        self._memory_size += len(data)
        if self._folder is None:
            return
        for old in list(self._memory):
            if self._memory_size <= _CACHE:
                break
            kept = self._kept.get(old)
            if kept is None or not kept.passing:
                self._memory_size -= len(self._memory.pop(old))

    def _path(self, kept: Kept) -> Path:
        assert self._folder is not None
        stem = f'{int(kept.importance)}_{kept.stamp_ns}_{kept.name.boot:x}_{kept.name.number}'
        return self._folder / f'{stem}.item'

    def _write(self, kept: Kept, data: bytes) -> None:
        """Write an item, on a full disk in the place of less important ones."""
        freed = 0
        while (failure := self._failure(kept, data)) is not None:
            with self._lock:
                worst = max(
                    (each for each in self._kept.values() if not each.passing),
                    key=_order,
                    default=kept,
                )
                # What others on the disk take at once is not given up for them.
                enough = freed >= 2 * len(data) + _BLOCK
                if failure.errno not in _FULL or enough or _order(worst) <= _order(kept):
                    # It stays in memory as long as there is room.
                    self.unwritten += 1
                    return
                freed += worst.size
                self.remove(worst)
                self.dropped += 1

    def _failure(self, kept: Kept, data: bytes) -> OSError | None:
        """Write an item's file; why it could not be written, if so."""
        path = self._path(kept)
        aside = path.with_suffix('.part')
        try:
            aside.write_bytes(data)
            os.replace(aside, path)
        except OSError as reason:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            return reason
        return None

    def _find(self, path: Path) -> None:
        """Take up a file of an earlier start; halves and strangers' are left out."""
        match = _NAME.fullmatch(path.name)
        if match is None:
            if path.suffix == '.part':
                path.unlink(missing_ok=True)
            return
        size = path.stat().st_size
        if int(match[1]) > max(Importance) or size > LARGEST_ITEM:
            return
        name = Name(int(match[3], 16), int(match[4]))
        kept = Kept(name, Importance(int(match[1])), int(match[2]), '', size)
        self._kept[name] = kept
        self.size += size


def _order(kept: Kept) -> tuple[int, int]:
    """The larger, the sooner an item is dropped: the least important, of these the oldest."""
    return kept.importance, -kept.stamp_ns
