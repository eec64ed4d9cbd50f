"""What the fits take of a surface, by their windows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import WIDTH, gaussian_of


def over_rows(nodes: NDArray[np.float32], rows: int) -> NDArray[np.float32]:
    """A field's means over so many rows of pixels around the nodes, as bins are.

    What it is made of is compared with the bins, and would else be as smooth as they are.
    """
    beside = (rows**2 - 1) / (24 * rows**2)
    weights = np.array([beside, 1 - 2 * beside, beside], np.float32)
    along_u = np.ones(1, np.float32)
    means: Any = cv2.sepFilter2D(nodes, -1, along_u, weights, borderType=cv2.BORDER_REPLICATE)
    # Beyond the image a surface goes on as straight as it ends.
    means[[0, -1]] = nodes[[0, -1]]
    return means


@dataclass(frozen=True)
class Response:
    """Of Gaussian fits, each of which corrects the ones before: they leave out (1 - G)^fits.

    Attributes
    ----------
    sigma : float
        Standard deviation of the Gaussians with the averages that bins and nodes are, pixels.
    pitch : tuple of 2 ints
        Pixels between nodes along u and v.
    fits : int
    """

    sigma: float
    period: float
    pitch: tuple[int, int]
    fits: int

    @classmethod
    def of(cls, period: float, grid: Grid, fits: int) -> Response:
        """Of fits to fringes of `period` pixels."""
        return cls(WIDTH * period, period, grid.pitch, fits)

    def left_out(self, nodes: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the fits leave out of a field at the nodes."""
        along_u, along_v = (self.sigma / pitch for pitch in self.pitch)
        for _ in range(self.fits):
            nodes = nodes - gaussian_of(nodes, along_u, along_v, cv2.BORDER_REPLICATE)
        return nodes

    def wavelength(self, share: NDArray[np.float32]) -> NDArray[np.float32]:
        """Wavelength of which half is left, pixels.

        Parameters
        ----------
        share : ndarray
            Of what the fits leave out of their own result, that is put back: q (1 - share (1 - q))
            is left out then, with q = (1 - G)^fits.
        """
        rest = 1 - share
        left_out = 1 / (rest + np.sqrt(np.square(rest) + 2 * share))
        # Fits are a power of two: roots take a tenth of the time of other powers.
        for _ in range(self.fits.bit_length() - 1):
            left_out = np.sqrt(left_out)
        gaussian = 1 - left_out
        return np.float32(math.pi * math.sqrt(2) * self.sigma) / np.sqrt(-np.log(gaussian))
