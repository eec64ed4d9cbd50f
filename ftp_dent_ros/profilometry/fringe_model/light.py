"""The light of a photograph as bins, in grey levels: 255ths of white."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ftp_dent_ros.photograph.photograph import FULL, Photograph
from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, BinGrid

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
    weight : ndarray, shape (rows, columns), float32
        How much a usable bin counts: the square of the albedo that is divided out, as noise is
        divided, too, over the brightest bin's.
    has_stripe : bool
        Whether one fringe has red alone.
    certain : ndarray or float
        Share that a bin counts for: less than 1 where an edge of paint may lie elsewhere.
    """

    colours: list[NDArray[np.float32]]
    shares: tuple[float, ...]
    usable: NDArray[np.float32]
    weight: NDArray[np.float32]
    has_stripe: bool
    certain: NDArray[np.float32] | float = 1.0

    @classmethod
    def of(
        cls,
        photograph: Photograph,
        grid: BinGrid,
        has_stripe: bool,
        albedo: NDArray[np.float32] | None = None,
        black: float = 0.0,
    ) -> Light:
        """Light of a photograph, less `black` grey levels, over the albedo of its pixels."""
        pixels: Any = photograph.rgb() if photograph.mosaic else photograph.pixels
        planes: Any = [pixels] if pixels.ndim == 2 else cv2.split(pixels)
        sharp = planes
        if photograph.mosaic:
            sharp = [cv2.filter2D(each, -1, _SIX_POINTS) for each in planes]
        usable = np.ones(grid.shape, np.float32)
        full = FULL * photograph.white
        if photograph.highest > full:
            clipped = np.maximum.reduce(planes) > full
            usable = (grid.binned(clipped.astype(np.uint8)) < _FEW).astype(np.float32)
        weight = usable
        if albedo is not None:
            sharp = [(each - np.float32(black / photograph.unit)) / albedo for each in sharp]
            bins = grid.binned(albedo)
            weight = usable * np.square(bins / bins.max())
        colours = [grid.binned(each) * np.float32(photograph.unit) for each in sharp]
        shares = _MOSAIC if photograph.mosaic else _LUMA
        return cls(colours, shares if len(planes) > 1 else (1.0,), usable, weight, has_stripe)

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


@dataclass(frozen=True, eq=False)
class LightNoise:
    """Variance of the noise over the light it is in.

    Attributes
    ----------
    parts : ndarray, shape (3,)
        Of the sensor, of photons over the light, and of paint and dirt over its square.
    """

    parts: NDArray[np.float32] = field(default_factory=lambda: np.array([1, 0, 0], np.float32))

    @classmethod
    def of(
        cls,
        light: NDArray[np.float32],
        residual: NDArray[np.float32],
        weight: NDArray[np.float32],
        scale: NDArray[np.float32],
    ) -> LightNoise:
        """Noise by least squares, no part of which is negative.

        Parameters
        ----------
        light, residual, weight, scale : ndarray, shape (bins,)
            Light of the model, what it leaves, the weight of that, and the mean square about,
            which is not zero.
        """
        powers = np.vander(np.maximum(light, 0).astype(float), 3, increasing=True)
        unit = np.maximum(powers.mean(axis=0), 1)
        by = np.sqrt(weight) / scale
        # Of four rows instead of all bins, which leave the same.
        few: Any = np.linalg.qr(
            np.column_stack([powers / unit, np.square(residual)]) * by[:, None], 'r'
        )
        parts, _ = nnls(few[:, :3], few[:, 3])
        return cls((parts / unit).astype(np.float32))

    def precision(
        self, light: NDArray[np.float32], level: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Inverse variance in light over that at the fringes' level (eq. 5)."""
        sensor, photons, paint = self.parts
        usual, here = (
            (paint * x + photons) * x + (sensor + np.float32(ROUNDING))
            for x in (np.abs(level), np.abs(light))
        )
        return usual / here
