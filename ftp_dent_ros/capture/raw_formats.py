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


_ORDERS = {'GR': 'grbg', 'RG': 'rggb', 'GB': 'gbrg', 'BG': 'bggr'}


def _genicam() -> dict[int, RawFormat]:
    """Codes of the Pixel Format Naming Convention (PFNC, EMVA)."""
    formats: dict[int, RawFormat] = {
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
    for index, order in enumerate(('GR', 'RG', 'GB', 'BG')):
        mosaic = _ORDERS[order]
        for first, bits, packing in (
            (0x01080008, 8, ''),
            (0x0110000C, 10, ''),
            (0x01100010, 12, ''),
            (0x0110002E, 16, ''),
            (0x010C0026, 10, 'packed'),
            (0x010C002A, 12, 'packed'),
        ):
            formats[first + index] = RawFormat(bits, mosaic, packing=packing)
    for index, order in enumerate(('BG', 'GB', 'GR', 'RG')):
        for first, bits in ((0x010A0052, 10), (0x010C0053, 12)):
            formats[first + 2 * index] = RawFormat(bits, _ORDERS[order], packing='p')
    return formats


def _v4l2() -> dict[str, RawFormat]:
    """Codes of videodev2.h."""
    formats = {
        'GREY': RawFormat(8),
        'Y10 ': RawFormat(10),
        'Y12 ': RawFormat(12),
        'Y14 ': RawFormat(14),
        'Y16 ': RawFormat(16),
    }
    names: dict[str, Any] = {
        'bggr': ('BA81', 'BG10', 'BG12', 'BYR2'),
        'gbrg': ('GBRG', 'GB10', 'GB12', 'GB16'),
        'grbg': ('GRBG', 'BA10', 'BA12', 'GR16'),
        'rggb': ('RGGB', 'RG10', 'RG12', 'RG16'),
    }
    for mosaic, codes in names.items():
        for code, bits in zip(codes, (8, 10, 12, 16), strict=True):
            formats[code] = RawFormat(bits, mosaic)
    return formats


GENICAM = _genicam()
V4L2 = _v4l2()
