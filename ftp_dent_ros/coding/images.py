"""sensor_msgs/Image to photographs and to RGB pixels.

What cameras publish: 8 and 16 bits, any order of colours, grey, Bayer and packed YUV, with padded
lines; everything else is refused with a sentence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.photograph.photograph import MOSAICS, Photograph

if TYPE_CHECKING:
    from sensor_msgs.msg import Image


# Two pixels share their colour.
_IN_PAIRS: dict[str, int] = {
    'yuv422': cv2.COLOR_YUV2RGB_UYVY,
    'uyvy': cv2.COLOR_YUV2RGB_UYVY,
    'yuv422_yuy2': cv2.COLOR_YUV2RGB_YUY2,
    'yuyv': cv2.COLOR_YUV2RGB_YUY2,
}
_CHANNELS = {'rgb': 3, 'bgr': 3, 'rgba': 4, 'bgra': 4, 'mono': 1}
_CHANNELS |= {f'bayer_{mosaic}': 1 for mosaic in MOSAICS}
# Encodings of sensor_msgs/image_encodings.hpp: channels and bytes a channel.
_ENCODINGS = {
    f'{name}{8 * size}': (channels, size)
    for size in (1, 2)
    for name, channels in _CHANNELS.items()
} | dict.fromkeys(_IN_PAIRS, (2, 1))


def photograph_from_message(message: Image, bits: int = 0) -> Photograph:
    """Photograph of a sensor_msgs/Image.

    Parameters
    ----------
    message : sensor_msgs/Image
    bits : int
        Of a level that has two bytes, if they are its lower ones; 0 for all sixteen.

    Returns
    -------
    Photograph
        It may share memory with the message: don't write to it.

    Raises
    ------
    ImageError
        The encoding is not known, or the sizes or bits do not agree with the data.
    """
    encoding = message.encoding
    if encoding not in _ENCODINGS:
        raise ImageError(
            f'the image has the encoding {encoding!r}: publish one of {", ".join(_ENCODINGS)}'
        )
    if encoding in _IN_PAIRS and message.width % 2:
        raise ImageError(
            f'the image is {message.width} pixels wide, but {encoding} has its colours in pairs '
            'of pixels: publish an even width'
        )
    pixels = _pixels(message, *_ENCODINGS[encoding])
    if encoding in _IN_PAIRS:
        return Photograph(np.asarray(cv2.cvtColor(pixels, _IN_PAIRS[encoding]), np.uint8))
    used = bits if pixels.dtype == np.uint16 else 0
    if pixels.shape[2] == 1:
        mosaic = encoding.removeprefix('bayer_')[:4] if encoding.startswith('bayer_') else ''
        return Photograph.of(pixels[..., 0], mosaic, used)
    colours = pixels[..., :3]
    if encoding.startswith('bgr'):
        colours = colours[..., ::-1]
    return Photograph.of(np.ascontiguousarray(colours), bits=used)


def image_from_message(message: Image) -> NDArray[np.uint8]:
    """RGB pixels of 8 bits of a sensor_msgs/Image, shape (height, width, 3), to look at.

    They may share memory with the message: don't write to them. Raises as
    `photograph_from_message`.
    """
    return photograph_from_message(message).shown()


def _pixels(message: Image, channels: int, size: int) -> NDArray[Any]:
    """Levels of a message, shape (height, width, channels), uint8 or uint16."""
    height, width, step = message.height, message.width, message.step
    line = width * channels * size
    if not line or not height or step < line or len(message.data) != step * height:
        raise ImageError(
            f'the image says {width}x{height} pixels of {message.encoding} with step {step}, but '
            f'holds {len(message.data)} bytes: correct the publisher'
        )
    lines = np.frombuffer(message.data, np.uint8).reshape(height, step)[:, :line]
    lines = np.ascontiguousarray(lines)
    if size == 2:
        levels = lines.view('>u2' if message.is_bigendian else '<u2')
        lines = levels.astype(np.uint16, copy=False)
    return lines.reshape(height, width, channels)
