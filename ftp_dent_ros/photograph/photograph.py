"""A photograph as a camera takes it: grey, in colours, or through a mosaic of colour filters."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError, ImageError

#: Mosaics of colour filters: the colours of the first two pixels of the first and second row.
MOSAICS = ('rggb', 'bggr', 'gbrg', 'grbg')
# OpenCV names a mosaic by the second and third pixel of its second row.
_TO_RGB = {
    'rggb': cv2.COLOR_BayerBG2RGB,
    'bggr': cv2.COLOR_BayerRG2RGB,
    'gbrg': cv2.COLOR_BayerGR2RGB,
    'grbg': cv2.COLOR_BayerGB2RGB,
}
#: Share of white from which on a level is full; demosaicing may lower 255 by one.
FULL = 253.5 / 255
_WHITE16 = 65535
_ENCODING = re.compile(r'(mono|rgb|bayer_(?:rggb|bggr|gbrg|grbg))(8|1[0246])')


@dataclass(frozen=True)
class Encoding:
    """What pixels mean, as a name tells: ``mono12``, ``bayer_rggb10``, ``rgb8``.

    Attributes
    ----------
    mosaic : str
        As of a `Photograph`.
    coloured : bool
        Whether a pixel has three levels.
    bits : int
        Of a level: 8, 10, 12, 14 or 16.
    """

    mosaic: str
    coloured: bool
    bits: int

    @staticmethod
    def is_name(name: str) -> bool:
        """Whether an encoding has that name."""
        return _ENCODING.fullmatch(name) is not None

    @classmethod
    def named(cls, name: str) -> Encoding:
        """Encoding of a name; raises `ConfigurationError` if it is none."""
        match = _ENCODING.fullmatch(name)
        if match is None:
            raise ConfigurationError(
                f'the encoding is {name!r}: give mono, rgb or bayer_ and one of '
                f'{", ".join(MOSAICS)}, with 8, 10, 12, 14 or 16 bits, as mono12 or bayer_rggb12'
            )
        kind = match[1].removeprefix('bayer_')
        return cls(kind if kind in MOSAICS else '', kind == 'rgb', int(match[2]))


@dataclass(frozen=True, eq=False)
class Photograph:
    """Pixels, and what they mean.

    Attributes
    ----------
    pixels : ndarray, shape (height, width) or (height, width, 3), uint8 or uint16
        Levels: grey or of a mosaic, or RGB.
    white : int
        Level of a pixel that is full.
    mosaic : str
        One of `MOSAICS` if each pixel has one colour; else empty.

    Raises
    ------
    ImageError
        The pixels are not such, or hold levels above white.
    """

    pixels: NDArray[Any]
    white: int = 255
    mosaic: str = ''

    def __post_init__(self) -> None:
        pixels = self.pixels
        if not isinstance(pixels, np.ndarray) or pixels.dtype not in (np.uint8, np.uint16):
            kind = getattr(pixels, 'dtype', type(pixels).__name__)
            raise ImageError(
                f'the image is of {kind}, not of 8- or 16-bit levels: give unsigned whole numbers'
            )
        if pixels.ndim != 2 and (self.mosaic or pixels.ndim != 3 or pixels.shape[2] != 3):
            size = 'x'.join(map(str, pixels.shape))
            raise ImageError(f'the image has the shape {size}: give grey, RGB or raw pixels')
        if self.mosaic and self.mosaic not in MOSAICS:
            raise ImageError(f'the mosaic is {self.mosaic!r}: give one of {", ".join(MOSAICS)}')
        most = np.iinfo(pixels.dtype).max
        if not 15 <= self.white <= most:
            raise ImageError(f'white is {self.white}, outside 15 to {most}: correct it')
        if self.white < most and pixels.size and pixels.max() > self.white:
            raise ImageError(
                f'the image holds the level {pixels.max()}, more than {self.bits} bits have: '
                'tell how many bits it has'
            )

    @classmethod
    def of(cls, image: NDArray[Any] | Photograph, mosaic: str = '', bits: int = 0) -> Photograph:
        """Photograph of an array; one that is a photograph already stays as it is.

        Parameters
        ----------
        image : ndarray, shape (height, width) or (height, width, 3), uint8 or uint16
        mosaic : str
        bits : int
            Of each level, in the lower bits; 0 for all that the type has.
        """
        if isinstance(image, Photograph):
            return image
        most = 16 if getattr(image, 'dtype', None) == np.uint16 else 8
        return cls(image, (1 << (bits or most)) - 1, mosaic)

    @property
    def transposed(self) -> Photograph:
        """The same pixels with columns for rows, and rows for columns."""
        mosaic = ''.join(self.mosaic[place] for place in (0, 2, 1, 3)) if self.mosaic else ''
        pixels = np.ascontiguousarray(self.pixels.swapaxes(0, 1))
        return replace(self, pixels=pixels, mosaic=mosaic)

    @property
    def height(self) -> int:
        """Rows of pixels."""
        return self.pixels.shape[0]

    @property
    def width(self) -> int:
        """Columns of pixels."""
        return self.pixels.shape[1]

    @property
    def bits(self) -> int:
        """Of each level."""
        return self.white.bit_length()

    @cached_property
    def highest(self) -> int:
        """Highest level."""
        return int(self.pixels.max(initial=0))

    @property
    def brightest(self) -> float:
        """Highest level as a share of white."""
        return self.highest / self.white

    @property
    def encoding(self) -> str:
        """Name after sensor_msgs, with the bits that there are: ``mono12``, ``bayer_rggb8``."""
        kind = f'bayer_{self.mosaic}' if self.mosaic else 'mono' if self.is_flat else 'rgb'
        return f'{kind}{self.bits}'

    @property
    def is_flat(self) -> bool:
        """Whether it has one level a pixel."""
        return self.pixels.ndim == 2

    @property
    def is_grey(self) -> bool:
        """Whether it shows no colours, though it may have three levels a pixel."""
        if self.is_flat:
            return not self.mosaic
        red, green, blue = np.moveaxis(self.pixels, -1, 0)
        return np.array_equal(red, green) and np.array_equal(green, blue)

    @property
    def unit(self) -> float:
        """Factor from levels to grey levels of 8 bits, in which the engine computes."""
        return 255 / self.white

    def linear(self, response: NDArray[np.floating]) -> Photograph:
        """The photograph in levels that grow with the light, of 16 bits.

        Parameters
        ----------
        response : ndarray, shape (levels,)
            Light, 0 to 1, of evenly spaced levels from black to white.
        """
        share = np.arange(self.white + 1) / self.white
        light = np.interp(share, np.linspace(0, 1, len(response)), response)
        # What is full stays so, though the curve is steep there.
        light[share >= FULL] = 1
        table = np.rint(_WHITE16 * light).astype(np.uint16)
        pixels = np.asarray(np.take(table, self.pixels))
        return Photograph(pixels, _WHITE16, self.mosaic)

    def lattices(self) -> list[tuple[str, int, int]]:
        """Colour, first row and first column of each pixel of the mosaic's tile."""
        return [(colour, *divmod(index, 2)) for index, colour in enumerate(self.mosaic)]

    def rgb(self) -> NDArray[Any]:
        """Levels of three colours, shape (height, width, 3), a mosaic interpolated."""
        if not self.is_flat:
            return self.pixels
        conversion = _TO_RGB[self.mosaic] if self.mosaic else cv2.COLOR_GRAY2RGB
        return np.asarray(cv2.cvtColor(self.pixels, conversion), self.pixels.dtype)

    def shown(self) -> NDArray[np.uint8]:
        """RGB of 8 bits, shape (height, width, 3), to look at."""
        rgb = self.rgb()
        if self.white == 255:
            return rgb.astype(np.uint8, copy=False)
        return (rgb * np.float32(self.unit) + np.float32(0.5)).astype(np.uint8)
