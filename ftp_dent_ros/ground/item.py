"""What crosses the air: one message of the payload, how important it is, and its bytes."""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from ftp_dent_ros.errors import CodecError

_HEAD = struct.Struct('<H')
_END = struct.Struct('<I')
# Bytes: names of topics and types are far shorter.
_LARGEST_HEADER = 4096


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
            if size > _LARGEST_HEADER:
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
