"""The projector's light: its pixels, square and defocused, as a field over its image."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ftp_dent_ros.simulation.photography.photometry import Photometry

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

    unit = np.float32(1 / _FULL)

    def __init__(self, projected: NDArray[np.uint8], photometry: Photometry) -> None:
        level = (np.arange(256) / 255) ** photometry.projector_gamma
        level = photometry.projector_black + (1 - photometry.projector_black) * level
        light: Image = (_FULL * level).astype(np.float32)[projected]
        self._border = math.ceil(4 * photometry.defocus_px) + 2
        border = ((self._border, self._border), (self._border, self._border), (0, 0))
        light = np.repeat(np.pad(light, border), _FINE, axis=1)
        # Linear interpolation blurs too, by a variance of a sixth of a sample.
        blur = max((_FINE * photometry.defocus_px) ** 2 - 1 / 6, 0)
        along_u = _pixel_kernel(math.sqrt(blur))
        along_v = _pixel_kernel(photometry.defocus_px)
        light = cv2.sepFilter2D(light, -1, along_u, along_v, borderType=cv2.BORDER_REPLICATE)
        # Four channels of 16 bits are what cv2.remap is quickest with.
        self._field = np.zeros((*light.shape[:2], 4), np.uint16)
        self._field[..., :3] = np.rint(light)

    def index(self, u: NDArray, v: NDArray) -> Image:
        """Index (column, row) into the field of projector pixels of one shape, shape (2, ...)."""
        column = np.multiply(u, _FINE, dtype=float)
        column += _FINE * (self._border + 0.5) - 0.5
        return np.array([column, v + self._border], np.float32)

    def index_change(self, drift: NDArray) -> Image:
        """Change of an index with a change of projector pixels, both of shape (2, ...)."""
        scale = np.array([_FINE, 1], np.float32)
        return drift * scale.reshape(2, *(1,) * (drift.ndim - 1))

    def add(self, total: Image, column: Image, row: Image) -> None:
        """Add the light at indices of shape (h, w) to a sum of shape (h, w, 4)."""
        cv2.accumulate(self.sample(column, row), total)

    def mean(self, total: Image, count: int) -> Image:
        """Mean of the `count` images of light, 0 to 1, that were added, shape (3, h, w)."""
        scale = self.unit / np.float32(count)
        return np.stack([total[..., channel] * scale for channel in range(3)])

    def at(self, u: NDArray, v: NDArray) -> Image:
        """Light, 0 to 1, at a list of projector pixels of shape (n,), shape (3, n)."""
        rows = -(-len(u) // _COLUMNS)
        index = np.full((2, rows * _COLUMNS), -1.0, np.float32)
        index[:, : len(u)] = self.index(u, v)
        column, row = index.reshape(2, rows, _COLUMNS)
        light = self.sample(column, row).reshape(-1, 4)[: len(u), :3]
        return light.T * self.unit

    def sample(self, column: NDArray, row: NDArray) -> Image:
        """Light at indices of shape (h, w), in units of `unit`, shape (h, w, 4)."""
        return cv2.remap(self._field, column, row, cv2.INTER_LINEAR, borderValue=0)


def _pixel_kernel(sigma: float) -> Image:
    """Gaussian blur integrated over each sample's width: weights of the samples around one."""
    if sigma == 0:
        return np.ones(1, np.float32)
    reach = math.ceil(4 * sigma)
    edges = np.arange(-reach, reach + 2) - 0.5
    weights = np.diff(erf(edges / (math.sqrt(2) * sigma)))
    return (weights / weights.sum()).astype(np.float32)
