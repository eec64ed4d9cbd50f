"""Bytes of an item as they cross the air: deflated against one of the same topic before it.

Messages of a topic are alike: a list of dents grows by a few, a pose moves, of a node's state some
numbers change. What the ground has already need not be sent again.
"""

from __future__ import annotations

import struct
import zlib

from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.protocol import LARGEST_ITEM

# Of a reference, bytes: deflate looks back over no more than 32 kB.
LARGEST = 40_000
# The reference's number, or one of these.
_NUMBER = struct.Struct('<I')
_AS_IT_IS, _ALONE = 0, 0xFFFFFFFF
_RAW = -15  # deflate without a header or checksum: the item has its own


def shortened(whole: bytes, number: int = 0, reference: bytes = b'') -> bytes:
    """Bytes to send.

    Parameters
    ----------
    whole : bytes
        The item.
    number : int
        Of the item that the ground has; 0 for none.
    reference : bytes
        That item.
    """
    writer = (
        zlib.compressobj(9, zlib.DEFLATED, _RAW, 9, zdict=reference)
        if number
        else zlib.compressobj(9, zlib.DEFLATED, _RAW, 9)
    )
    short = writer.compress(whole) + writer.flush()
    if len(short) >= len(whole):
        return as_it_is(whole)
    return _NUMBER.pack(number or _ALONE) + short


def as_it_is(whole: bytes) -> bytes:
    """Bytes to send of an item that is compressed in its own way."""
    return _NUMBER.pack(_AS_IT_IS) + whole


def reference_number(sent: bytes) -> int:
    """Number of the item that `lengthened` needs; 0 for none.

    Raises
    ------
    CodecError
        The bytes are cut short.
    """
    if len(sent) < _NUMBER.size:
        raise CodecError('an item is cut short: it is refused')
    (number,) = _NUMBER.unpack_from(sent)
    return 0 if number in (_AS_IT_IS, _ALONE) else number


def lengthened(sent: bytes, reference: bytes = b'') -> bytes:
    """The item of `shortened`'s bytes.

    Raises
    ------
    CodecError
        The bytes are damaged, or claim to be of too large an item.
    """
    number = reference_number(sent)
    if _NUMBER.unpack_from(sent)[0] == _AS_IT_IS:
        return sent[_NUMBER.size :]
    reader = zlib.decompressobj(_RAW, zdict=reference) if number else zlib.decompressobj(_RAW)
    try:
        whole = reader.decompress(sent[_NUMBER.size :], LARGEST_ITEM)
    except zlib.error as reason:
        raise CodecError(f'an item is damaged ({reason}): it is refused') from None
    if not reader.eof:
        raise CodecError('an item is damaged or too large: it is refused')
    return whole
