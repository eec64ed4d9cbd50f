"""Photographs in files: PNG, TIFF and JPEG, of 8 or 16 bits, in colours, grey or raw."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.photograph.photograph import Encoding, Photograph

_SUFFIXES = ('.png', '.jpg', '.jpeg', '.tif', '.tiff')
# Bits that cameras have and files keep in sixteen.
_BITS = (10, 12, 14, 16)


def is_photograph(path: str | Path) -> bool:
    """Whether a file's name is that of a photograph."""
    return Path(path).suffix.lower() in _SUFFIXES


def read_photograph(path: str | Path, encoding: str = '') -> Photograph:
    """Read a photograph.

    Parameters
    ----------
    path : path
    encoding : str
        What a file cannot say, as `Encoding.named` reads it. Without, one level a pixel is grey,
        and levels of sixteen bits have as many as the highest of them needs, of 10, 12, 14, 16.

    Raises
    ------
    ImageError
        The file is no photograph, cannot be decoded, or is not of this encoding.
    ConfigurationError
        The encoding is none.
    """
    if not is_photograph(path):
        raise ImageError(f'{path}: not a photograph: give one of {", ".join(_SUFFIXES)}')
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as reason:
        raise ImageError(f'{path}: cannot be read ({reason.strerror}): check the path') from None
    with _silent():
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if image is None:
        raise ImageError(f'{path}: empty, damaged or not an image: take it again')
    return photograph_of_bgr(image, encoding, str(path))


def photograph_of_bgr(image: NDArray, encoding: str, where: str) -> Photograph:
    """Photograph of OpenCV's pixels, BGR or grey; errors name `where` they came from."""
    levels = image.shape[2] if image.ndim == 3 else 1
    if image.dtype not in (np.uint8, np.uint16) or levels not in (1, 3, 4):
        raise ImageError(
            f'{where}: {image.dtype} in shape {image.shape}, not levels of 8 or 16 bits of one '
            'or three colours: save it as PNG or TIFF of such'
        )
    known = Encoding.named(encoding) if encoding else None
    bits = 8 * image.dtype.itemsize
    if known and (known.coloured != (levels > 1) or known.bits > bits):
        raise ImageError(
            f'{where}: has {"one level" if levels == 1 else "three levels"} of {bits} bits a '
            f'pixel, which is not {encoding}: correct the encoding'
        )
    pixels = image[..., 2::-1] if levels > 1 else image.reshape(image.shape[:2])
    pixels = np.ascontiguousarray(pixels)
    if known:
        return Photograph.of(pixels, known.mosaic, known.bits)
    highest = int(pixels.max()) if image.dtype == np.uint16 and pixels.size else 0
    return Photograph.of(pixels, bits=next(b for b in _BITS if highest < 1 << b) if highest else 0)


@contextmanager
def _silent() -> Iterator[None]:
    """Keep the decoders' own words about damaged files off the standard error."""
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, 'wb') as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
