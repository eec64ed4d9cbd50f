"""A photograph's light, as bins in grey levels: 255ths of white, however many bits there are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.photograph.photograph import FULL, Photograph
from ftp_dent_ros.profilometry.least_squares.bins.compression import jpeg_variance
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.pixel_noise import PixelNoise

# Shares of red, green and blue in luma (ITU-R BT.601), in which the errors of demosaicing and of
# JPEG cancel, and in the mean of a mosaic's pixels.
IN_LUMA, IN_MOSAIC = (0.299, 0.587, 0.114), (0.25, 0.5, 0.25)
# Share of a bin, in light, that may be clipped: noise clips some pixels below that level, by no
# more than its own standard deviation.
_FEW = 0.1


@dataclass(frozen=True)
class IntensityBins:
    """Bins of a photograph, of shape (rows, columns), float32, in grey levels.

    Attributes
    ----------
    red : ndarray
        The fringes go on through a red stripe in it; as `grey` where there is none.
    grey : ndarray
        The least noise, but no fringe in a red stripe.
    noise : PixelNoise
        Of a pixel of the grey levels.
    clipping : ndarray
        Share of each bin that is clipped, in light.
    red_share : float
        Of `red` in `grey`.
    """

    red: NDArray[np.float32]
    grey: NDArray[np.float32]
    noise: PixelNoise
    clipping: NDArray[np.float32]
    red_share: float

    @classmethod
    def of(cls, photograph: Photograph, grid: Grid, stripe: bool = True) -> IntensityBins:
        """Bins of a photograph.

        Parameters
        ----------
        photograph : Photograph
        grid : Grid
        stripe : bool
            Whether one fringe has no green and blue. If not, all that the sensor sees shows all
            fringes; if so, the photograph must have colours.
        """
        if photograph.mosaic:
            light = _of_mosaic(photograph, grid)
        else:
            light = _of_planes(photograph, grid, stripe)
        red, grey, noise, clipping, share = light
        return cls(red if stripe else grey, grey, noise, clipping, share if stripe else 1.0)

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """Bins that clipped pixels are a part of."""
        return self.clipping > _FEW

    def others(self, rows: NDArray[np.integer]) -> NDArray[np.float32]:
        """Green and blue in some rows."""
        share = np.float32(self.red_share)
        return (self.grey[rows] - share * self.red[rows]) / (1 - share)


def _of_planes(photograph: Photograph, grid: Grid, stripe: bool) -> tuple[Any, ...]:
    """Red, for a stripe alone, grey, noise, clipping and red's share of whole planes of pixels."""
    unit = np.float32(photograph.unit)
    plane: Any = photograph.pixels
    if not photograph.is_flat:
        # Whole levels, as JPEG has its luma: what its decoding rounded in each colour goes again.
        plane = cv2.cvtColor(plane, cv2.COLOR_RGB2GRAY)
    noise = PixelNoise.of(plane, unit=photograph.unit, step=photograph.step)
    if plane.dtype == np.uint8:
        noise = noise.at_least(jpeg_variance(plane) * photograph.unit**2)
    red = grey = grid.binned(plane) * unit
    if stripe and not photograph.is_flat:
        red = grid.binned(cv2.extractChannel(photograph.pixels, 0)) * unit
    full = _full(photograph)
    if full is None:
        clipping = np.zeros(grid.bin_shape, np.float32)
    else:
        seen: Any = full if photograph.is_flat else cv2.cvtColor(full, cv2.COLOR_RGB2GRAY)
        clipping = grid.binned(seen) / np.float32(255)
    return red, grey, noise, clipping, IN_LUMA[0]


def _of_mosaic(photograph: Photograph, grid: Grid) -> tuple[Any, ...]:
    """The same of a mosaic: each colour where its pixels are, and their mean."""
    pixels, unit = photograph.pixels, photograph.unit
    lattices = photograph.lattices()
    planes = [pixels[row::2, column::2] for _, row, column in lattices]
    height, width = min(map(len, planes)), min(plane.shape[1] for plane in planes)
    planes = [plane[:height, :width] for plane in planes]
    bins = [
        (colour, grid.binned_lattice(pixels, row, column) * np.float32(unit))
        for colour, row, column in lattices
    ]
    red = next(each for colour, each in bins if colour == 'r')
    grey = sum(each for _, each in bins) * np.float32(1 / len(bins))
    full = _full(photograph)
    clipping = np.zeros(grid.bin_shape, np.float32)
    if full is not None:
        clipping = grid.binned(full) / np.float32(255)
    noise = PixelNoise.of(*planes, unit=unit, step=photograph.step)
    return red, grey, noise, clipping, IN_MOSAIC[0]


def _full(photograph: Photograph) -> NDArray[np.uint8] | None:
    """255 for each level that is clipped, else 0; None if none is."""
    highest = FULL * photograph.white
    if photograph.highest <= highest:
        return None
    return (photograph.pixels > highest).view(np.uint8) * np.uint8(255)
