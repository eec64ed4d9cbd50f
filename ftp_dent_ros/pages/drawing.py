"""The pictures of a page, as data that stands in it."""

from __future__ import annotations

import base64
import io
import math
from typing import TYPE_CHECKING, Any

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: RGB of what was not measured.
NOTHING = (225, 227, 230)


def data_uri(data: bytes, kind: str = 'image/png') -> str:
    """Data as they stand in a page that needs no other file."""
    return f'data:{kind};base64,{base64.b64encode(data).decode("ascii")}'


def coded(values: NDArray[np.floating]) -> str:
    """Numbers as a page's script reads them: single precision, little endian, base64."""
    return base64.b64encode(values.astype('<f4').tobytes()).decode('ascii')


def figure_png(figure: Figure, dpi: int = 110) -> bytes:
    """A figure of matplotlib as a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=dpi)
    return stream.getvalue()


def png(pixels: NDArray[np.uint8]) -> str:
    """RGB pixels as a data URI."""
    return data_uri(_file(pixels, '.png'))


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """RGB pixels as a JPEG file."""
    return _file(pixels, '.jpg', cv2.IMWRITE_JPEG_QUALITY, 88)


def _file(pixels: NDArray[np.uint8], kind: str, *how: int) -> bytes:
    return cv2.imencode(kind, np.ascontiguousarray(pixels[..., ::-1]), how)[1].tobytes()


def colours(name: str = 'RdBu_r') -> NDArray[np.uint8]:
    """RGB of 256 steps of a map of matplotlib, shape (256, 3).

    The map by default goes from the most outward deviation to the most inward one.
    """
    table = matplotlib.colormaps[name](np.linspace(0, 1, 256))[:, :3]
    return np.round(255 * table).astype(np.uint8)


def deviation_colours(deviation: NDArray[np.float32], limit: float) -> NDArray[np.uint8]:
    """RGB of deviations from -limit to limit, metres."""
    return coloured(deviation, -limit, limit)


def coloured(
    values: NDArray[np.floating], low: float, high: float, name: str = 'RdBu_r'
) -> NDArray[np.uint8]:
    """RGB of values between two limits by a map of colours, as of `colours`; grey of NaN."""
    share = np.clip(np.nan_to_num((values - low) / (high - low)), 0, 1)
    pixels = colours(name)[(255 * share).astype(np.uint8)]
    pixels[~np.isfinite(values)] = NOTHING
    return pixels


def depth_scale(limit: float) -> dict[str, Any]:
    """The colours of `deviation_colours`, and the depths in millimetres that they stand for."""
    values = np.linspace(-1, 1, 5) * limit * 1e3
    return {
        'data': png(colours()[None]),
        'marks': [f'{value:+.3g}' if value else '0' for value in values],
    }


def scale_bar(metres: float, width: float) -> dict[str, Any]:
    """A bar of a round length, a seventh or so of a picture's width.

    Parameters
    ----------
    metres : float
        That a unit of the picture is long.
    width : float
        Of the picture, in its units.
    """
    goal = metres * width / 7
    rounds = [step * 10.0**power for power in range(-3, 2) for step in (1, 2, 5)]
    length = min(rounds, key=lambda each: abs(math.log(each / goal)))
    text = f'{length:g} m' if length >= 1 else f'{length * 1e3:g} mm'
    return {'length': length / metres, 'text': text}
