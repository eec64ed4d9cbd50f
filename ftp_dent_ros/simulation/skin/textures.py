"""Images that marks are sampled from: noise that repeats, and letters."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Grains of a noise before it repeats (at 4 mm half a metre), and samples a grain: OpenCV 4 rounds
# positions to 1/32 of a sample.
_GRAINS = 128
_FINE = 8
# The correlation of white noise blurred by sigma is half at a distance of 1.67 sigma.
_GRAIN_SIGMA = 0.5 / 1.665
# Pixels of a letter's height: 0.1 mm of a letter of 20 mm.
LETTER = 200
# Of the images that lists of positions are made into.
_COLUMNS = 4096

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]


def noise(seed: int, octave: int, u: Image, v: Image) -> Image:
    """Smooth noise of mean 0 and variance 1 with grains one unit wide."""
    # OpenCV cannot wrap a map of positions: the field has a rim.
    column = np.mod(u, _GRAINS) * _FINE
    row = np.mod(v, _GRAINS) * _FINE
    return sampled(_grains(seed, octave), column, row)


@lru_cache(maxsize=16)
def _grains(seed: int, octave: int) -> Image:
    """A noise at `_FINE` samples a unit, its first column and row repeated at the end."""
    size = _GRAINS * _FINE
    white = np.random.default_rng([seed, octave]).standard_normal((size, size), np.float32)
    rim = 4 * _FINE
    padded = np.pad(white, rim, mode='wrap')
    smooth = cv2.GaussianBlur(padded, (0, 0), _GRAIN_SIGMA * _FINE)[rim : 1 - rim, rim : 1 - rim]
    return (smooth - smooth.mean()) / smooth.std()


@lru_cache(maxsize=8)
def letters_of(text: str) -> Image:
    """Cover of a line of text, 0 to 1, capitals `LETTER` pixels high and in the middle."""
    # OpenCV's versions draw other fonts under one name: measured on what is drawn.
    capital = np.flatnonzero(_drawn('H').any(axis=1))
    size = LETTER / len(capital)
    canvas = _drawn(text)
    above, below = capital[0], len(canvas) - 1 - capital[-1]
    rim = ((max(below - above, 0), max(above - below, 0)), (0, 0))
    letters: Image = cv2.resize(np.pad(canvas, rim), None, fx=size, fy=size)
    return letters.astype(np.float32) / 255


def _drawn(text: str) -> NDArray[np.uint8]:
    """A line of text with room around it; its height does not depend on the letters."""
    font, scale, thickness = cv2.FONT_HERSHEY_DUPLEX, 8.0, 24
    (_, height), below = cv2.getTextSize('H', font, scale, thickness)
    (width, _), _ = cv2.getTextSize(text, font, scale, thickness)
    room = below + thickness
    canvas = np.zeros((height + 2 * room, width + 2 * thickness), np.uint8)
    cv2.putText(canvas, text, (thickness, height + room), font, scale, 255, thickness, cv2.LINE_AA)
    return canvas


def sampled(field: Image, column: Image, row: Image) -> Image:
    """Linear interpolation of a field, 0 around it, at positions of any shape."""
    # OpenCV limits a side to 32767: a list is made an image.
    count = column.size
    shape, width = column.shape, min(max(count, 1), _COLUMNS)
    places = np.full((2, -(-count // width) * width), -2.0, np.float32)
    places[:, :count] = column.ravel(), row.ravel()
    column, row = places.reshape(2, -1, width)
    values = cv2.remap(field, column, row, cv2.INTER_LINEAR, borderValue=0)
    return values.ravel()[:count].reshape(shape)
