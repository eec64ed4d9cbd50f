"""Pieces to items again, on the ground."""

from __future__ import annotations

import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground import difference
from ftp_dent_ros.ground.frames import WINDOW, Name, Piece, Report
from ftp_dent_ros.ground.item import Item

# Bounds of what a drone, or whoever speaks in its name, can make the ground hold.
_MOST_BYTES = 64 << 20
_MOST_ITEMS = 64
_MOST_NAMES = 100_000
# Topics, and items of each that the drone may refer to: more than can be under way when it learns
# of the one that it has chosen.
_MOST_TOPICS, _MOST_REFERENCES = 24, WINDOW


@dataclass
class _Part:
    data: bytearray
    have: dict[int, int] = field(default_factory=dict)
    count: int = 0


class Assembly:
    """Puts items together and says what has come.

    Parameters
    ----------
    ground : bytes
        16 bytes that name this ground.
    instance : int
        Of this program.
    now : callable
        Monotonic time, seconds.
    """

    def __init__(
        self, ground: bytes, instance: int, now: Callable[[], float] = time.monotonic
    ) -> None:
        self.pieces = self.repeated = self.bytes = 0
        self._ground, self._instance = ground, instance
        self._now = now
        self._parts: OrderedDict[Name, _Part] = OrderedDict()
        self._held = 0
        self._done: OrderedDict[Name, None] = OrderedDict()
        self._references: dict[Name, bytes] = {}
        self._of_topic: OrderedDict[str, deque[Name]] = OrderedDict()
        self._link = self._sequence = self._received = 0

    def add(self, piece: Piece) -> Item | None:
        """Take a piece; the item that it makes whole, once.

        Raises
        ------
        CodecError
            The item's checksum is wrong, its pieces do not fit, or what it differs from is not
            here.
        """
        self._note(piece)
        self.pieces += 1
        self.bytes += len(piece.data)
        if piece.name in self._done:
            self.repeated += 1
            return None
        part = self._part(piece)
        if part.have.get(piece.offset) == len(piece.data):
            self.repeated += 1
            return None
        part.data[piece.offset : piece.offset + len(piece.data)] = piece.data
        part.have[piece.offset] = len(piece.data)
        if not _is_whole(part):
            return None
        self._drop(piece.name)
        self._finish(piece.name)
        return self._item(piece.name, bytes(part.data))

    def report(self) -> Report:
        """What has come so far."""
        return Report(self._ground, self._instance, self._link, self._sequence, self._received)

    @property
    def unfinished(self) -> int:
        """Items of which some pieces have come."""
        return len(self._parts)

    def _item(self, name: Name, sent: bytes) -> Item:
        number = difference.reference_number(sent)
        reference = self._references.get(Name(name.boot, number), b'')
        if number and not reference:
            raise CodecError('an item differs from one that never came: it is refused')
        whole = difference.lengthened(sent, reference)
        item = Item.unpack(whole)
        if len(whole) <= difference.LARGEST:
            self._remember(name, item.topic, whole)
        return item

    def _remember(self, name: Name, topic: str, whole: bytes) -> None:
        """Keep an item that later ones of its topic may differ from."""
        names = self._of_topic.setdefault(topic, deque())
        self._of_topic.move_to_end(topic)
        names.append(name)
        self._references[name] = whole
        gone = [names.popleft()] if len(names) > _MOST_REFERENCES else []
        if len(self._of_topic) > _MOST_TOPICS:
            gone += self._of_topic.popitem(last=False)[1]
        for each in gone:
            del self._references[each]

    def _note(self, piece: Piece) -> None:
        if piece.link != self._link:
            self._link, self._sequence, self._received = piece.link, piece.sequence, 1
            return
        ahead = piece.sequence - self._sequence
        if ahead > 0:
            self._received = (self._received << min(ahead, WINDOW) | 1) & ((1 << WINDOW) - 1)
            self._sequence = piece.sequence
        elif -ahead < WINDOW:
            self._received |= 1 << -ahead

    def _part(self, piece: Piece) -> _Part:
        part = self._parts.get(piece.name)
        if part is not None and len(part.data) != piece.total:
            self._drop(piece.name)
            raise CodecError('pieces of one item disagree on its size: they are refused')
        if part is None:
            while self._parts and (
                self._held + piece.total > _MOST_BYTES or len(self._parts) >= _MOST_ITEMS
            ):
                self._drop(next(iter(self._parts)))
            part = self._parts[piece.name] = _Part(bytearray(piece.total))
            self._held += piece.total
        return part

    def _drop(self, name: Name) -> None:
        self._held -= len(self._parts.pop(name).data)

    def _finish(self, name: Name) -> None:
        self._done[name] = None
        if len(self._done) > _MOST_NAMES:
            self._done.popitem(last=False)


def _is_whole(part: _Part) -> bool:
    """Whether the pieces cover the item; they may overlap when sent again in other sizes."""
    if sum(part.have.values()) < len(part.data):
        return False
    end = 0
    for offset in sorted(part.have):
        if offset > end:
            return False
        end = max(end, offset + part.have[offset])
    return end >= len(part.data)
