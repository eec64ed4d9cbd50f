"""The two messages of the link: a piece of an item down, and what has arrived up.

Pieces are numbered as they are sent, so that the ground can say which have come; an item is
named by the start of the drone's program (`boot`) and a number, so that none counts twice.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

from ftp_dent_ros.errors import CodecError

VERSION = 2
# Bytes: a whole cloud is coded in 0.1 MB, a picture in 0.3; and what a datagram holds.
LARGEST_ITEM = 32 << 20
LARGEST_PIECE = 1 << 16
WINDOW = 64  # pieces that may be under way: the bits of a report
_PIECE = struct.Struct('<2sBBQIIIII')
_REPORT = struct.Struct('<2sB16sQQQI')


class Name(NamedTuple):
    """Which item: the drone's start, and the item's number."""

    boot: int
    number: int


@dataclass(frozen=True)
class Piece:
    """Some bytes of an item.

    Attributes
    ----------
    name : Name
    sequence : int
        Of the pieces sent to this ground.
    link : int
        Of the drone's memory of this ground; a report must repeat it.
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
        return (
            _PIECE.pack(
                b'FP',
                VERSION,
                0,
                self.name.boot,
                self.name.number,
                self.link,
                self.sequence,
                self.total,
                self.offset,
            )
            + self.data
        )

    @staticmethod
    def unpack(data: bytes) -> Piece:
        """Piece of its bytes; raises `CodecError` if they are none that could be."""
        if not _PIECE.size < len(data) <= _PIECE.size + LARGEST_PIECE:
            raise CodecError('a piece has an impossible size: it is refused')
        magic, version, _, boot, number, link, sequence, total, offset = _PIECE.unpack_from(data)
        _check(magic, b'FP', version)
        body = data[_PIECE.size :]
        if total > LARGEST_ITEM or offset + len(body) > total:
            raise CodecError('a piece lies outside its item: it is refused')
        return Piece(Name(boot, number), link, sequence, total, offset, body)


@dataclass(frozen=True)
class Report:
    """What a ground has received.

    Attributes
    ----------
    ground : bytes
        16 bytes that name the ground, the same after a restart.
    instance : int
        Another one after each start.
    link, sequence : int
        Of the last piece; 0 for none.
    received : int
        Bit k: piece ``sequence - k`` has come.
    span_ms : int
        Since the last report, by the ground's clock.
    """

    ground: bytes
    instance: int
    link: int
    sequence: int
    received: int
    span_ms: int = 0

    def pack(self) -> bytes:
        """Bytes of the report."""
        return _REPORT.pack(
            b'FR',
            VERSION,
            self.ground,
            self.instance,
            self.link << 32 | self.sequence,
            self.received,
            self.span_ms,
        )

    @staticmethod
    def unpack(data: bytes) -> Report:
        """Report of its bytes; raises `CodecError` if they are none."""
        if len(data) != _REPORT.size:
            raise CodecError('a report has an impossible size: it is refused')
        magic, version, ground, instance, last, received, span = _REPORT.unpack(data)
        _check(magic, b'FR', version)
        return Report(ground, instance, last >> 32, last & 0xFFFFFFFF, received, span)


def _check(magic: bytes, expected: bytes, version: int) -> None:
    if magic != expected:
        raise CodecError('this is no message of the link: it is refused')
    if version != VERSION:
        raise CodecError(
            f'the link speaks version {version}, this program {VERSION}: use the same version at '
            'both ends'
        )
