"""What crosses the air: items, the pieces that they are sent in, and reports of what has come."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from ftp_dent_ros.errors import CodecError

VERSION = 3
# Bytes: a whole cloud is coded in 0.1 MB, a picture in 0.3.
LARGEST_ITEM = 32 << 20
# Bytes of an item that others may differ from: deflate looks back over no more than 32 kB.
LARGEST_REFERENCE = 40_000
WINDOW = 64  # pieces that may be in flight: the bits of a report
#: Without anything from the other end for so long (s) the link counts as lost.
SILENCE = 3.0
_HEAD = struct.Struct('<H')
_END = struct.Struct('<I')
# The number of the item that one differs from, or one of these.
_AS_IT_IS, _ALONE = 0, 0xFFFFFFFF
_RAW = -15  # deflate without a header or checksum: the item has its own
_PIECE = struct.Struct('<2sBxQIIIII')
_REPORT = struct.Struct('<2sB16sQIIQ')


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
    extra : dict
        What else a kind needs; JSON.
    """

    importance: Importance
    topic: str
    kind: str
    stamp_ns: int
    data: bytes
    latest: bool = False
    extra: dict[str, Any] = field(default_factory=dict)

    def pack(self) -> bytes:
        """Header, data, and the CRC-32 of both."""
        header = {
            'i': int(self.importance),
            't': self.topic,
            'k': self.kind,
            's': self.stamp_ns,
            'l': self.latest,
            'x': self.extra,
        }
        text = json.dumps(header, separators=(',', ':')).encode()
        whole = _HEAD.pack(len(text)) + text + self.data
        return whole + _END.pack(zlib.crc32(whole))

    @staticmethod
    def unpack(whole: bytes) -> Item:
        """Item of `pack`'s bytes.

        Raises
        ------
        CodecError
            They are damaged or malformed.
        """
        if len(whole) < _HEAD.size + _END.size:
            raise CodecError('an item is cut short: ask for it again')
        if zlib.crc32(whole[: -_END.size]) != _END.unpack(whole[-_END.size :])[0]:
            raise CodecError("an item's checksum is wrong: ask for it again")
        (size,) = _HEAD.unpack_from(whole)
        try:
            if size > 4096:  # names of topics and types are far shorter
                raise ValueError
            header = json.loads(whole[2 : 2 + size])
            item = Item(
                Importance(header['i']),
                header['t'],
                header['k'],
                header['s'],
                whole[2 + size : -_END.size],
                bool(header['l']),
                header['x'],
            )
            texts = isinstance(item.topic, str) and isinstance(item.kind, str)
            if not (texts and type(item.stamp_ns) is int and isinstance(item.extra, dict)):
                raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise CodecError('the header of an item is malformed: ask for it again') from None
        return item


class Name(NamedTuple):
    """Which item: the drone's start, and the item's number."""

    boot: int
    number: int


class Piece(NamedTuple):
    """Some bytes of an item.

    Attributes
    ----------
    name : Name
    link : int
        Of the drone's memory of this ground; a report must repeat it.
    sequence : int
        Of the pieces sent to this ground.
    total, offset : int
        Bytes of the item, and of those before this piece.
    data : bytes
    """

    name: Name
    link: int
    sequence: int
    total: int
    offset: int
    data: bytes

    def pack(self) -> bytes:
        """Bytes of the piece."""
        return _PIECE.pack(b'FP', VERSION, *self.name, *self[1:-1]) + self.data

    @staticmethod
    def unpack(data: bytes) -> Piece:
        """Piece of its bytes; raises `CodecError` if they are none that could be."""
        boot, number, link, sequence, total, offset = _unpacked(_PIECE, b'FP', data[: _PIECE.size])
        body = data[_PIECE.size :]
        # A datagram holds no more.
        whole = 0 < len(body) <= 1 << 16 and total <= LARGEST_ITEM
        if not whole or offset + len(body) > total:
            raise CodecError('a piece lies outside its item: it is refused')
        return Piece(Name(boot, number), link, sequence, total, offset, body)


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
        return _REPORT.pack(b'FR', VERSION, *self)

    @staticmethod
    def unpack(data: bytes) -> Report:
        """Report of its bytes; raises `CodecError` if they are none."""
        return Report(*_unpacked(_REPORT, b'FR', data))


def _unpacked(form: struct.Struct, magic: bytes, data: bytes) -> list[Any]:
    """Fields of a frame, behind its magic and version."""
    if len(data) != form.size or not data.startswith(magic):
        raise CodecError('this is no message of the link: it is refused')
    _, version, *fields = form.unpack(data)
    if version != VERSION:
        raise CodecError(
            f'the link speaks version {version}, this program {VERSION}: use the same version at '
            'both ends'
        )
    return fields


def deflate(whole: bytes, number: int = 0, reference: bytes = b'') -> bytes:
    """Bytes of an item as they cross the air, deflated against one of the same topic before it.

    Messages of a topic are alike: what the ground has already need not be sent again.

    Parameters
    ----------
    whole : bytes
        The item.
    number : int
        Of the item that the ground has; 0 for none.
    reference : bytes
        That item.
    """
    writer = zlib.compressobj(9, zlib.DEFLATED, _RAW, 9, zdict=reference)
    short = writer.compress(whole) + writer.flush()
    if len(short) >= len(whole):
        return wrap(whole)
    return _END.pack(number or _ALONE) + short


def wrap(whole: bytes) -> bytes:
    """Bytes to send of an item that is compressed in its own format."""
    return _END.pack(_AS_IT_IS) + whole


def inflate(sent: bytes, known: Callable[[int], bytes | None] = lambda number: None) -> bytes:
    """The item of `deflate`'s bytes.

    Parameters
    ----------
    sent : bytes
    known : callable
        Gives the item of a number that this one may differ from; None if it is not here.

    Raises
    ------
    CodecError
        The bytes are damaged, claim to be of too large an item, or differ from what is not here.
    """
    if len(sent) < _END.size:
        raise CodecError('an item is cut short: it is refused')
    (number,), short = _END.unpack_from(sent), sent[_END.size :]
    if number == _AS_IT_IS:
        return short
    reference = b'' if number == _ALONE else known(number)
    if reference is None:
        raise CodecError('an item differs from one that never came: it is refused')
    reader = zlib.decompressobj(_RAW, zdict=reference)
    try:
        whole = reader.decompress(short, LARGEST_ITEM)
    except zlib.error as reason:
        raise CodecError(f'an item is damaged ({reason}): it is refused') from None
    if not reader.eof:
        raise CodecError('an item is damaged or too large: it is refused')
    return whole
