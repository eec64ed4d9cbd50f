"""The projector's light: its pixels, square and defocused, as a field over its image."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ftp_dent_ros.simulation.photometry import Photometry

# Samples a projector pixel along u. OpenCV 4 rounds positions to 1/32 of a sample.
_FINE = 4
_FULL = 60000.0
# Image rows that `at` makes of a list of positions: OpenCV limits a side to 32767.
_COLUMNS = 4096

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]


class Light:
    """Light that leaves the projector towards each point of its image.

    Parameters
    ----------
    projected : ndarray, shape (height, width, 3), uint8
        The projected image, RGB.
    photometry : Photometry

    Notes
    -----
    A pixel is a square of even light; the lens blurs it with a Gaussian; around the frame there
    is no light, not even the projector's black. The field is sampled `_FINE` times a pixel
    along u, where fringes vary, and once along v; in between it is linear.
    """

    def __init__(self, projected: NDArray[np.uint8], photometry: Photometry) -> None:
        level = (np.arange(256) / 255) ** photometry.projector_gamma
        level = photometry.projector_black + (1 - photometry.projector_black) * level
        light: Image = (_FULL * level).astype(np.float32)[projected]
        self._border = math.ceil(4 * photometry.defocus_px) + 2
        border = ((self._border, self._border), (self._border, self._border), (0, 0))
        light = np.repeat(np.pad(light, border), _FINE, axis=1)
        along_u = _pixel_kernel(_FINE * photometry.defocus_px)
        along_v = _pixel_kernel(photometry.defocus_px)
        light = cv2.sepFilter2D(light, -1, along_u, along_v, borderType=cv2.BORDER_REPLICATE)
        # Four channels of 16 bits are what cv2.remap is quickest with.
        self._field = np.zeros((*light.shape[:2], 4), np.uint16)
        self._field[..., :3] = np.rint(light)

    def column_index(self, u: NDArray) -> Image:
        """Index along the field's rows of projector columns `u`."""
        return (_FINE * u + (_FINE * (self._border + 0.5) - 0.5)).astype(np.float32)

    def row_index(self, v: NDArray) -> Image:
        """Index along the field's columns of projector rows `v`."""
        return (v + self._border).astype(np.float32)

    def add_image(self, total: Image, column: Image, row: Image) -> None:
        """Add the light at indices of shape (h, w) to `total`, shape (h, w, 4), unscaled."""
        cv2.accumulate(self._sample(column, row), total)

    def scaled(self, total: Image, count: int) -> Image:
        """Mean of `count` sums of `add_image` as light, 0 to 1, shape (h, w, 3)."""
        return total[..., :3] * np.float32(1 / (_FULL * count))

    def at(self, u: NDArray, v: NDArray) -> Image:
        """Light, 0 to 1, at a list of projector positions of shape (n,), shape (n, 3)."""
        rows = -(-len(u) // _COLUMNS)
        index = np.full((2, rows * _COLUMNS), -1.0, np.float32)
        index[0, : len(u)] = self.column_index(u)
        index[1, : len(u)] = self.row_index(v)
        column, row = index.reshape(2, rows, _COLUMNS)
        light = self._sample(column, row).reshape(-1, 4)
        return light[: len(u), :3] * np.float32(1 / _FULL)

    def _sample(self, column: NDArray, row: NDArray) -> Image:
        return cv2.remap(self._field, column, row, cv2.INTER_LINEAR, borderValue=0)


def _pixel_kernel(sigma: float) -> Image:
    """Gaussian blur integrated over each sample's width: weights of the samples around one."""
    if sigma == 0:
        return np.ones(1, np.float32)
    reach = math.ceil(4 * sigma)
    edges = np.arange(-reach, reach + 2) - 0.5
    weights = np.diff(erf(edges / (math.sqrt(2) * sigma)))
    return (weights / weights.sum()).astype(np.float32)
