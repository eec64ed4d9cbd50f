"""The light of a photograph as bins, in grey levels: 255ths of white."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.photograph.photograph import FULL, Photograph
from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid

# Shares of red, green and blue in luma (ITU-R BT.601), and in the pixels of a mosaic.
_LUMA, _MOSAIC = (0.299, 0.587, 0.114), (0.25, 0.5, 0.25)
# Share of a bin that may be clipped: noise clips single pixels below white.
_FEW = 0.1
# Makes linear interpolation along rows Lagrange's of six points: every other pixel of a fringe 8
# pixels wide has 0.95 of its amplitude, not 0.71, which would be seen beside the others.
_SIX_POINTS = np.array([[3, -6, -16, 38, 90, 38, -16, -6, 3]]) / 128


@dataclass(frozen=True, eq=False)
class Light:
    """Bins of the colours.

    Attributes
    ----------
    colours : list of ndarray, shape (rows, columns), float32
        Red, green and blue, or grey alone.
    shares : tuple of float
        Of the colours in the grey light that has the least noise.
    usable : ndarray, shape (rows, columns), float32
        1 where no pixel is clipped, else 0.
    has_stripe : bool
        Whether one fringe has red alone.
    """

    colours: list[NDArray[np.float32]]
    shares: tuple[float, ...]
    usable: NDArray[np.float32]
    has_stripe: bool

    @classmethod
    def of(
        cls,
        photograph: Photograph,
        grid: BinGrid,
        has_stripe: bool,
        albedo: NDArray[np.float32] | None = None,
    ) -> Light:
        """Light of a photograph, over the albedo of its pixels."""
        pixels: Any = photograph.rgb() if photograph.mosaic else photograph.pixels
        planes: Any = [pixels] if pixels.ndim == 2 else cv2.split(pixels)
        sharp = planes
        if photograph.mosaic:
            sharp = [cv2.filter2D(each, -1, _SIX_POINTS) for each in planes]
        if albedo is not None:
            sharp = [each / albedo for each in sharp]
        colours = [grid.binned(each) * np.float32(photograph.unit) for each in sharp]
        shares = _MOSAIC if photograph.mosaic else _LUMA
        usable = np.ones(grid.shape, np.float32)
        full = FULL * photograph.white
        if photograph.highest > full:
            clipped = np.maximum.reduce(planes) > full
            usable = (grid.binned(clipped.astype(np.uint8)) < _FEW).astype(np.float32)
        return cls(colours, shares if len(planes) > 1 else (1.0,), usable, has_stripe)

    @property
    def unbroken(self) -> NDArray[np.float32]:
        """Light that has all fringes: red if there is a red stripe, else grey."""
        return self.colours[0] if self.has_stripe else self.grey

    @property
    def coded(self) -> NDArray[np.float32]:
        """Light that the code changes: green and blue if there is a red stripe, else grey."""
        if not self.has_stripe:
            return self.grey
        return self.grey - np.float32(self.shares[0]) * self.colours[0]

    @cached_property
    def grey(self) -> NDArray[np.float32]:
        """The colours by their shares."""
        grey = np.zeros_like(self.colours[0])
        for share, colour in zip(self.shares, self.colours, strict=True):
            grey += np.float32(share) * colour
        return grey
