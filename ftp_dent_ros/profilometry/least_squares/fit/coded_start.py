"""The first fit of coded fringes, made again with their code.

The first fit knows of no code and ripples with it, more finely than windows resolve, so that no
further fit would take it off. So one more is made about it, and its result, phase and step alike,
is seen through the windows: to first order they show the true phase, whatever the first fit was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.code_blur import excess_blur
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import ContrastModel, Envelope
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import MaskedFit

# Fringes along u by which the first fit's rim is uncertain.
_RIM = 0.6
# Windows that light is smoothed over for its slope: two, which hold no fringe any more.
_LIGHT = 2.0
_LEAST = 1e-2
# Share of a window that must be on the surface for a fit of its own; of one that is whole; and
# standard deviations of a window that a rim is away from it.
_LEAST_SHARE, _WHOLE, _REACH = 0.7, 0.95, 2.0
# Fits, each with the blur that the last one shows, and what it may be wrong by for the last one,
# radians^2: it tells a change but for an eighth.
_FITS, _NEAR = 3, 0.1


@dataclass(frozen=True, eq=False)
class Decoded:
    """Phase that is free of the code.

    Attributes
    ----------
    shift : ndarray, shape (rows, columns), float32
        Phase less the reference's at the nodes, radians.
    envelope : Envelope
        Of the fringes.
    blur, variance : ndarray, shape (rows, columns), float32
        Variance of the blur, and that of the phase by what is not known of it, radians^2.
    """

    shift: NDArray[np.float32]
    envelope: Envelope
    blur: NDArray[np.float32]
    variance: NDArray[np.float32]


class CodedStart:
    """Fits with a pattern's code in windows.

    Parameters
    ----------
    model : ContrastModel
    grid : Grid
    windows : Windows
    period : float
        Of the fringes, pixels.
    """

    def __init__(self, model: ContrastModel, grid: Grid, windows: Windows, period: float) -> None:
        self._model, self.grid, self.windows = model, grid, windows
        self._rim = math.ceil(grid.bins / 2 + _RIM * period / grid.step)
        self._masked = MaskedFit(grid, windows)

    def decoded(
        self,
        light: IntensityBins,
        base: NDArray[np.float32],
        shift: NDArray[np.float32],
        region: NDArray[np.bool_],
        blur: NDArray[np.float32],
    ) -> Decoded:
        """Fit about the first fit.

        Parameters
        ----------
        light : IntensityBins
        base : ndarray, shape (rows, bins), float32
            Absolute phase of a smooth surface near the true one, at the bins.
        shift : ndarray, shape (rows, columns), float32
            Phase of the first fit less that at the nodes, continued beyond the region.
        region : ndarray, shape (rows, columns), bool
            Nodes of the surface.
        blur : ndarray, shape (rows, columns), float32
            Variance of the blur that is expected, radians^2.
        """
        grid, model = self.grid, self._model
        inside = grid.to_bins(region).view(np.uint8)
        mask = cv2.erode(inside, np.ones((3, 2 * self._rim + 1)), borderValue=0) > 0
        clipped = None
        if light.clipped.any():
            clipped = self._mean((light.clipped & mask).astype(np.float32))
            mask &= ~light.clipped
        weight = mask.astype(np.float32)
        share = self._mean(weight)
        beyond = Extrapolation(self._sure(share), self.windows)
        share = at_least(share, _LEAST_SHARE)
        levelled = self._levelled(light, weight)
        for _ in range(_FITS):
            envelope = model.envelope(grid.to_bins(blur))
            at_bins = grid.at_bins(shift)
            equations = self._masked.equations(base + at_bins, mask, clipped, envelope)
            step = equations.step(levelled)
            # A window that ends at the rim speaks for a place that is not its node's.
            shift = beyond.by_slope(self._mean(weight * at_bins) / share + step)
            phase = base + grid.at_bins(shift)
            more = excess_blur(model, grid, self.windows, light.grey, phase, mask, blur)
            blur = blur + more.excess
            if np.abs(more.excess[region]).mean() < _NEAR:
                break
        return Decoded(
            shift,
            model.envelope(grid.to_bins(blur)),
            blur,
            np.square(more.deviation * np.float32(model.ripple)),
        )

    def _sure(self, share) -> NDArray[np.bool_]:
        """Nodes whose windows are whole, and those near none of which enough is seen."""
        whole = share > _WHOLE
        windows = self.windows
        size = [2 * math.ceil(_REACH * each) + 1 for each in (windows.sigma_v, windows.sigma_u)]
        near = cv2.dilate(whole.view(np.uint8), np.ones(size, np.uint8)) > 0
        return whole | (~near & (share > _LEAST_SHARE))

    def _levelled(self, light, weight) -> NDArray[np.float32]:
        """Light less its smooth mean, the slope of which would be taken for fringes."""
        mean, share = (
            self.windows.gaussian(self.grid.at_nodes(each), _LIGHT)
            for each in (weight * light.grey, weight)
        )
        return light.grey - self.grid.at_bins(mean / at_least(share, _LEAST))

    def _mean(self, bins) -> NDArray[np.float32]:
        """Mean of bins in the windows."""
        return self.windows.gaussian(self.grid.at_nodes(bins))
