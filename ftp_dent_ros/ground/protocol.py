"""What crosses the air: items, the pieces that they are sent in, and reports of what has come."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

from ftp_dent_ros.coding.cloud_codec import RayGrid
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.rig.rig import Lens

Key = TypeVar('Key')
Value = TypeVar('Value')
# Bytes: a whole cloud is coded in 0.1 MB, a picture in 0.3.
LARGEST_ITEM = 32 << 20
# Names of topics and types are far shorter.
_LARGEST_HEADER = 4096
# Bytes of an item that others may differ from: deflate looks back over no more than 32 kB.
LARGEST_REFERENCE = 40_000
WINDOW = 64  # pieces that may be in flight: the bits of a report
#: Without anything from the other end for so long (s) the link counts as lost.
SILENCE = 3.0
_HEAD = struct.Struct('<H')
_CHECKSUM = struct.Struct('<I')
_NAME = struct.Struct('<Q')
_RAW = -15  # deflate without a header or checksum: the item has its own
# Of another version of the link they are other ones.
_PIECE, _PIECE_MARK = struct.Struct('<4sQIIII'), b'FP4 '
_REPORT, _REPORT_MARK = struct.Struct('<4s16sQIIQ'), b'FR4 '


def remember(last: dict[Key, Value], key: Key, value: Value, most: int) -> None:
    """Note a value, and forget the oldest of more than so many: what comes may be anything."""
    last[key] = value
    if len(last) > most:
        del last[next(iter(last))]


class Importance(IntEnum):
    """In which order items go: all of one before any of the next.

    Of one importance the newest go first: what is seen now is worth more than what was seen, and a
    link that does not carry all of it still shows the present.
    """

    STATE = 0
    DENTS = 1
    POSES = 2
    PREVIEWS = 3
    CLOUDS = 4
    PICTURES = 5


# Only the newest of a topic is of use, so that one that waits gives way to the next.
REPLACED = frozenset({Importance.STATE, Importance.PREVIEWS})


@dataclass(frozen=True)
class Item:
    """One message, coded.

    Attributes
    ----------
    importance : Importance
    topic, kind : str
        The topic on the ground, and how `data` is coded: ``cdr:TYPE``, ``cloud`` or ``jpeg``.
    stamp_ns : int
        Of the message, in ROS time.
    data : bytes
    latest : bool
        Whether it takes the place of the topic's item before (a latched list).
    frame : str
        Of the message.
    lens : Lens or None
        That a picture was taken with.
    """

    importance: Importance
    topic: str
    kind: str
    stamp_ns: int
    data: bytes
    latest: bool = False
    frame: str = ''
    lens: Lens | None = None

    def pack(self) -> bytes:
        """Header, data, and the CRC-32 of both."""
        lens = RayGrid(self.lens, 1).numbers() if self.lens else ()
        names = self.topic, self.kind, self.frame
        header = [self.importance, *names, self.stamp_ns, self.latest, lens]
        text = json.dumps(header, separators=(',', ':')).encode()
        whole = _HEAD.pack(len(text)) + text + self.data
        return whole + _CHECKSUM.pack(zlib.crc32(whole))

    @staticmethod
    def unpack(whole: bytes) -> Item:
        """Item of `pack`'s bytes.

        Raises
        ------
        CodecError
            They are damaged or malformed.
        """
        body, end = whole[: -_CHECKSUM.size], whole[-_CHECKSUM.size :]
        if end != _CHECKSUM.pack(zlib.crc32(body)):
            raise CodecError("an item's checksum is wrong: it is refused")
        try:
            (size,) = _HEAD.unpack_from(body)
            start = _HEAD.size + min(size, _LARGEST_HEADER)
            header = json.loads(body[_HEAD.size : start])
            importance, topic, kind, frame, stamp, latest, lens = header
            return Item(
                Importance(importance),
                str(topic),
                str(kind),
                int(stamp),
                body[start:],
                bool(latest),
                str(frame),
                RayGrid.from_numbers(lens).lens if lens else None,
            )
        except (struct.error, ValueError, TypeError, ArithmeticError, RecursionError):
            raise CodecError('the header of an item is malformed: it is refused') from None


class Piece(NamedTuple):
    """Some bytes of an item.

    Attributes
    ----------
    name : int
        Of the item: no other has it, of this start of the drone or of another.
    link : int
        Of the drone's memory of this ground; a report must repeat it.
    sequence : int
        Of the pieces sent to this ground.
    total, offset : int
        Bytes of the item, and of those before this piece.
    data : bytes
    """

    name: int
    link: int
    sequence: int
    total: int
    offset: int
    data: bytes

    def pack(self) -> bytes:
        """Bytes of the piece."""
        return _PIECE.pack(_PIECE_MARK, *self[:-1]) + self.data

    @staticmethod
    def unpack(data: bytes) -> Piece:
        """Piece of its bytes; raises `CodecError` if they are none that could be."""
        body = data[_PIECE.size :]
        head = _unpacked(_PIECE, _PIECE_MARK, data[: _PIECE.size])
        piece = Piece._make((*head, body))
        # A datagram holds no more.
        fits = 0 < len(body) <= 1 << 16 and piece.offset + len(body) <= piece.total
        if not fits or piece.total > LARGEST_ITEM:
            raise CodecError('a piece lies outside its item: it is refused')
        return piece


class Report(NamedTuple):
    """What a ground has received.

    Attributes
    ----------
    ground : bytes
        16 bytes that name the ground, the same after a restart.
    instance : int
        Another one after each start.
    sequence, link : int
        Of the last piece; 0 for none.
    received : int
        Bit k: piece ``sequence - k`` has come.
    """

    ground: bytes
    instance: int
    sequence: int
    link: int
    received: int

    def pack(self) -> bytes:
        """Bytes of the report."""
        return _REPORT.pack(_REPORT_MARK, *self)

    @staticmethod
    def unpack(data: bytes) -> Report:
        """Report of its bytes; raises `CodecError` if they are none."""
        return Report(*_unpacked(_REPORT, _REPORT_MARK, data))


def _unpacked(form: struct.Struct, mark: bytes, data: bytes) -> tuple[Any, ...]:
    """Fields of a frame, behind its mark."""
    if len(data) != form.size or not data.startswith(mark):
        raise CodecError('this is no message of the link, or of another version: it is refused')
    return form.unpack(data)[1:]


def deflate(whole: bytes, name: int = 0, reference: bytes = b'', level: int = 9) -> bytes:
    """Bytes of an item as they cross the air, deflated against one of the same topic before it.

    Messages of a topic are alike: what the ground has already need not be sent again.

    Parameters
    ----------
    whole : bytes
        The item.
    name : int
        Of the item that the ground has; 0 for none.
    reference : bytes
        That item.
    level : int
        Of zlib; 0 for what is compressed in its own format.
    """
    writer = zlib.compressobj(level, zlib.DEFLATED, _RAW, 9, zdict=reference)
    return _NAME.pack(name) + writer.compress(whole) + writer.flush()


def inflate(sent: bytes, known: Callable[[int], bytes | None] = lambda name: None) -> bytes:
    """The item of `deflate`'s bytes.

    Parameters
    ----------
    sent : bytes
    known : callable
        Gives the item of a name that this one may differ from; None if it is not here.

    Raises
    ------
    CodecError
        The bytes are damaged, claim to be of too large an item, or differ from what is not here.
    """
    try:
        (name,) = _NAME.unpack_from(sent)
        reference = known(name) if name else b''
        if reference is None:
            raise CodecError('an item differs from one that never came: it is refused')
        reader = zlib.decompressobj(_RAW, zdict=reference)
        whole = reader.decompress(sent[_NAME.size :], LARGEST_ITEM)
    except (struct.error, zlib.error) as reason:
        raise CodecError(f'an item is damaged ({reason}): it is refused') from None
    if not reader.eof:
        raise CodecError('an item is damaged or too large: it is refused')
    return whole
