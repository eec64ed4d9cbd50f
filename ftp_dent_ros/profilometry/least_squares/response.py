"""What the fits take of a surface, by their windows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.windows import WIDTH, gaussian_of


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
    pitch: tuple[int, int]
    fits: int

    @classmethod
    def of(cls, period: float, grid: Grid, fits: int) -> Response:
        """Of fits to fringes of `period` pixels."""
        return cls(WIDTH * period, grid.pitch, fits)

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
        gaussian = 1 - left_out ** np.float32(1 / self.fits)
        return np.float32(math.pi * math.sqrt(2) * self.sigma) / np.sqrt(-np.log(gaussian))
