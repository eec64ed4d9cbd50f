"""sensor_msgs/Image to RGB pixels.

`image_from_message` takes what cameras publish: 8 and 16 bits, any order of colours, grey, Bayer
and packed YUV, with padded lines; everything else is refused with a sentence.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ImageError

if TYPE_CHECKING:
    from sensor_msgs.msg import Image

# Encodings of sensor_msgs/image_encodings.hpp: channels, bytes a channel, conversion to RGB.
# OpenCV names a Bayer pattern by its second row, ROS by its first.
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    'rgb8': (3, 1, None),
    'bgr8': (3, 1, cv2.COLOR_BGR2RGB),
    'rgba8': (4, 1, cv2.COLOR_RGBA2RGB),
    'bgra8': (4, 1, cv2.COLOR_BGRA2RGB),
    'mono8': (1, 1, cv2.COLOR_GRAY2RGB),
    'rgb16': (3, 2, None),
    'bgr16': (3, 2, cv2.COLOR_BGR2RGB),
    'rgba16': (4, 2, cv2.COLOR_RGBA2RGB),
    'bgra16': (4, 2, cv2.COLOR_BGRA2RGB),
    'mono16': (1, 2, cv2.COLOR_GRAY2RGB),
    'bayer_rggb8': (1, 1, cv2.COLOR_BayerBG2RGB),
    'bayer_bggr8': (1, 1, cv2.COLOR_BayerRG2RGB),
    'bayer_gbrg8': (1, 1, cv2.COLOR_BayerGR2RGB),
    'bayer_grbg8': (1, 1, cv2.COLOR_BayerGB2RGB),
    'yuv422': (2, 1, cv2.COLOR_YUV2RGB_UYVY),
    'uyvy': (2, 1, cv2.COLOR_YUV2RGB_UYVY),
    'yuv422_yuy2': (2, 1, cv2.COLOR_YUV2RGB_YUY2),
    'yuyv': (2, 1, cv2.COLOR_YUV2RGB_YUY2),
}
# Two pixels share their colour.
_IN_PAIRS = ('yuv422', 'uyvy', 'yuv422_yuy2', 'yuyv')


def image_from_message(message: Image) -> NDArray[np.uint8]:
    """RGB pixels of a sensor_msgs/Image.

    Returns
    -------
    ndarray, shape (height, width, 3), uint8
        Of 16 bits the upper eight. It may share memory with the message: don't write to it.

    Raises
    ------
    ImageError
        The encoding is not known, or the sizes do not agree with the data.
    """
    if message.encoding not in _ENCODINGS:
        raise ImageError(
            f'the image has the encoding {message.encoding!r}: '
            f'publish one of {", ".join(_ENCODINGS)}'
        )
    channels, size, conversion = _ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    line = width * channels * size
    if not line or not height or step < line or len(message.data) != step * height:
        raise ImageError(
            f'the image says {width}x{height} pixels of {message.encoding} with step {step}, but '
            f'holds {len(message.data)} bytes: correct the publisher'
        )
    if message.encoding in _IN_PAIRS and width % 2:
        raise ImageError(
            f'the image is {width} pixels wide, but {message.encoding} has its colours in pairs '
            'of pixels: publish an even width'
        )
    pixels = np.frombuffer(message.data, np.uint8).reshape(height, step)[:, :line]
    pixels = pixels.reshape(height, width, channels, size)
    upper = 0 if message.is_bigendian else size - 1
    pixels = np.ascontiguousarray(pixels[..., upper])
    if conversion is None:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, conversion), np.uint8)
