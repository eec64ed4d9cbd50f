"""Pixels as cameras send them: grey, of a mosaic or in three colours, 8 to 16 bits, packed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CameraError
from ftp_dent_ros.photograph.photograph import Photograph


@dataclass(frozen=True)
class RawFormat:
    """How a camera sends its pixels.

    Attributes
    ----------
    bits : int
        Of a level.
    mosaic : str
        Of its colour filters, as `Photograph.mosaic`.
    colours : str
        Order of the levels of a pixel that has three: ``'rgb'`` or ``'bgr'``.
    packing : str
        Empty for whole bytes, two of them with the level in the lower bits; ``'p'`` for bits one
        after the other (PFNC's p); ``'packed'`` for GigE Vision's: the upper eight bits of each
        of two levels around a byte of the lower ones.
    """

    bits: int
    mosaic: str = ''
    colours: str = ''
    packing: str = ''

    def photograph(self, data: NDArray[np.uint8], width: int, height: int) -> Photograph:
        """Photograph of the bytes of a frame; lines may be longer than they need be.

        Raises
        ------
        CameraError
            There are too few of them.
        """
        levels = width * (len(self.colours) or 1)
        each = {'p': self.bits, 'packed': 12}.get(self.packing, 8 if self.bits == 8 else 16)
        needed = -(-levels * each // 8)
        # Packed lines follow each other without a gap.
        step = len(data) // height if len(data) % height == 0 and not self.packing else needed
        if step < needed or len(data) < step * height:
            raise CameraError(
                f'the camera sends {len(data)} bytes for {width}x{height} pixels of {self.bits} '
                'bits: check its pixel format and size'
            )
        if self.packing:
            flat = _unpacked(data, levels * height, self.bits, self.packing)
        else:
            lines = data[: step * height].reshape(height, step)[:, :needed]
            flat = np.ascontiguousarray(lines).view('u1' if each == 8 else '<u2')
        shape = (height, width, 3) if self.colours else (height, width)
        pixels = flat.reshape(shape).astype(f'u{flat.itemsize}', copy=False)
        if self.colours == 'bgr':
            pixels = np.ascontiguousarray(pixels[..., ::-1])
        return Photograph.of(pixels, self.mosaic, self.bits)


def _unpacked(data: NDArray[np.uint8], count: int, bits: int, packing: str) -> NDArray[np.uint16]:
    """The first `count` levels of packed bytes."""
    together = 2 if packing == 'packed' or bits == 12 else 4
    size = 3 if packing == 'packed' else together * bits // 8
    groups = -(-count // together)
    padded = np.zeros(groups * size, np.uint16)
    given = data[: len(padded)]
    padded[: len(given)] = given
    parts = padded.reshape(groups, size)
    if packing == 'packed':
        low = bits - 8
        levels: NDArray[Any] = parts[:, [0, 2]] << low
        levels[:, 0] |= parts[:, 1] & (1 << low) - 1
        levels[:, 1] |= parts[:, 1] >> 4 & (1 << low) - 1
    else:
        first, shift = np.divmod(bits * np.arange(together, dtype=np.uint16), 8)
        levels = parts[:, first] >> shift | parts[:, first + 1] << 8 - shift
        levels &= np.uint16((1 << bits) - 1)
    return levels.reshape(-1)[:count]


# Codes of the Pixel Format Naming Convention (PFNC, EMVA): grey and colours, then mosaics.
GENICAM = {
    0x01080001: RawFormat(8),
    0x01100003: RawFormat(10),
    0x01100005: RawFormat(12),
    0x01100025: RawFormat(14),
    0x01100007: RawFormat(16),
    0x010A0046: RawFormat(10, packing='p'),
    0x010C0047: RawFormat(12, packing='p'),
    0x010C0004: RawFormat(10, packing='packed'),
    0x010C0006: RawFormat(12, packing='packed'),
    0x02180014: RawFormat(8, colours='rgb'),
    0x02180015: RawFormat(8, colours='bgr'),
    0x02300018: RawFormat(10, colours='rgb'),
    0x02300019: RawFormat(10, colours='bgr'),
    0x0230001A: RawFormat(12, colours='rgb'),
    0x0230001B: RawFormat(12, colours='bgr'),
    0x02300033: RawFormat(16, colours='rgb'),
    0x0230004B: RawFormat(16, colours='bgr'),
}
for _place, _mosaic in enumerate(('grbg', 'rggb', 'gbrg', 'bggr')):
    # The codes of bits one after the other stand in another order, with gaps.
    _packed = 2 * ('bggr', 'gbrg', 'grbg', 'rggb').index(_mosaic)
    GENICAM |= {
        0x01080008 + _place: RawFormat(8, _mosaic),
        0x0110000C + _place: RawFormat(10, _mosaic),
        0x01100010 + _place: RawFormat(12, _mosaic),
        0x0110002E + _place: RawFormat(16, _mosaic),
        0x010C0026 + _place: RawFormat(10, _mosaic, packing='packed'),
        0x010C002A + _place: RawFormat(12, _mosaic, packing='packed'),
        0x010A0052 + _packed: RawFormat(10, _mosaic, packing='p'),
        0x010C0053 + _packed: RawFormat(12, _mosaic, packing='p'),
    }
# Codes of videodev2.h, by the bits of a level.
_CODES = {
    '': {8: 'GREY', 10: 'Y10 ', 12: 'Y12 ', 14: 'Y14 ', 16: 'Y16 '},
    'bggr': {8: 'BA81', 10: 'BG10', 12: 'BG12', 16: 'BYR2'},
    'gbrg': {8: 'GBRG', 10: 'GB10', 12: 'GB12', 16: 'GB16'},
    'grbg': {8: 'GRBG', 10: 'BA10', 12: 'BA12', 16: 'GR16'},
    'rggb': {8: 'RGGB', 10: 'RG10', 12: 'RG12', 16: 'RG16'},
}
V4L2 = {
    code: RawFormat(bits, mosaic)
    for mosaic, codes in _CODES.items()
    for bits, code in codes.items()
}
