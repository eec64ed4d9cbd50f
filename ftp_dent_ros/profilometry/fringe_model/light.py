"""The light of a photograph as bins, in grey levels: 255ths of white."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.photograph.photograph import FULL, Photograph
from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid

#: Share of red in luma (ITU-R BT.601).
RED = np.float32(0.299)
# Share of a bin that may be clipped: noise clips single pixels below white.
_FEW = 0.1
# Of a mosaic: about each pixel the colours weigh as in a cell, red 1/4, green 1/2, blue 1/4.
_CELL = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True, eq=False)
class Light:
    """Bins, shape (rows, columns), float32.

    Attributes
    ----------
    grey : ndarray
        Luma, which has the least noise.
    red : ndarray
        Red alone, in which the fringes go on through a red stripe; `grey` without colours.
    usable : ndarray
        1 where no pixel is clipped, else 0.
    """

    grey: NDArray[np.float32]
    red: NDArray[np.float32]
    usable: NDArray[np.float32]

    @classmethod
    def of(cls, photograph: Photograph, grid: BinGrid) -> Light:
        """Light of a photograph.

        Of a mosaic the grey is that of its cells, without interpolation of colours.
        """
        unit = np.float32(photograph.unit)
        pixels: Any = photograph.rgb() if photograph.mosaic else photograph.pixels
        colours = pixels.ndim == 3
        if photograph.mosaic:
            luma: Any = cv2.sepFilter2D(photograph.pixels, cv2.CV_32F, _CELL, _CELL)
        else:
            luma = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY) if colours else pixels
        grey = grid.binned(luma) * unit
        red = grid.binned(cv2.extractChannel(pixels, 0)) * unit if colours else grey
        usable = np.ones(grid.shape, np.float32)
        full = FULL * photograph.white
        if photograph.highest > full:
            clipped = (pixels > full).any(axis=2) if colours else pixels > full
            usable = (grid.binned(clipped.astype(np.uint8)) < _FEW).astype(np.float32)
        return cls(grey, red, usable)

    @property
    def other(self) -> NDArray[np.float32]:
        """Green and blue as luma weighs them."""
        return self.grey - RED * self.red
