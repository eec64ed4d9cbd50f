"""What the skin's albedo feigns of the phase, told by what else it does to the light.

An albedo that varies as fast as the fringes shifts them. It also leaves light of twice their
frequency, and it changes their contrast, the amplitude over the mean level: neither is a
surface's doing. How much of the phase goes with either, the photograph itself says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows, coarsened
from ftp_dent_ros.profilometry.least_squares.noise.bands import SCALES
from ftp_dent_ros.robust import median

# Width of the neighbourhood that is judged over, windows, and the weight of the whole.
_NEIGHBOURHOOD, _GLOBAL = 11.2, 0.1
# Phase that albedo feigns over the sine of twice the phase that it leaves: 2 by theory (albedo
# t = 1 + e sin Phi makes e sin Phi + (e / 2) sin 2 Phi of 1 + cos Phi), more behind a lens that
# shows the double frequency less well.
_MOST_TEXTURE = 5.0
# Of the contrast's slope at fringes of full contrast c: of one albedo texture bears witness too,
# with an energy that goes with c^2. A third where it is of smooth grains.
_BESIDE_TEXTURE = np.float32(1 / 3)
_OUTLIER = 4.5
# The coarsest scale that a contrast is looked at: what is longer is the lens's and the light's.
_SMOOTH = SCALES[2]
_LEAST = np.float32(1e-12)


@dataclass(frozen=True)
class Feigned:
    """What of a phase is the albedo's; all at coarse nodes.

    Attributes
    ----------
    on_texture, on_slope : ndarray, shape (rows, columns), float32
        Phase that albedo feigns over texture, with the sign changed, and over the contrast's
        slope; the latter is 1 where one side band is all there is.
    explained : ndarray, shape (rows, columns), float32
        Share of the finest band's energy that albedo was.
    """

    on_texture: NDArray[np.float32]
    on_slope: NDArray[np.float32]
    explained: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        values: NDArray[np.float32],
        texture: NDArray[np.float32],
        slope: NDArray[np.float32],
        contrast: NDArray[np.float32],
        windows: Windows,
        every: int,
    ) -> Feigned:
        """Regression of the phase's finest band on those of texture and of the contrast's slope.

        Parameters
        ----------
        values, texture : ndarray, shape (rows, columns), float32
            Phase, and the sine of twice the fringes' phase in the light.
        slope : ndarray, shape (rows, columns), float32
            Of the logarithm of the contrast, without its trend.
        contrast : ndarray, shape (rows, columns), float32
            Of the fringes, as its logarithm.
        windows : Windows
        every : int
            Nodes along u and v that a coarse node takes together.
        """
        coarse = Windows(windows.sigma_u / every, windows.sigma_v / every)
        fine, grain, bent = (_finest(each, windows) for each in (values, -texture, slope))

        def mean(one, other):
            product = coarse.wide(coarsened(one * other, (every, every)), _NEIGHBOURHOOD)
            return product + np.float32(_GLOBAL) * product.mean()

        energy, of_grain, of_slope = mean(fine, fine), mean(grain, grain), mean(bent, bent)
        by_grain, by_slope, both = mean(fine, grain), mean(fine, bent), mean(grain, bent)
        power = np.minimum(np.exp(2 * coarsened(contrast, (every, every))), 1)
        most_slope = 1 - (1 - _BESIDE_TEXTURE) * power
        determinant = at_least(of_grain * of_slope - both * both, 0) + _LEAST * _LEAST
        on_slope = (by_slope * of_grain - both * by_grain) / determinant
        on_slope = np.clip(on_slope, 0, most_slope)
        on_texture = (by_grain - on_slope * both) / (of_grain + _LEAST)
        on_texture = np.clip(on_texture, 0, _MOST_TEXTURE)
        explained = on_texture * (2 * by_grain - on_texture * of_grain - 2 * on_slope * both)
        explained += on_slope * (2 * by_slope - on_slope * of_slope)
        return cls(on_texture, on_slope, np.clip(explained / (energy + _LEAST), 0, 1))


def slope_along_u(nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Half the difference of a field's neighbours along u, at the nodes.

    Nodes are about 0.6 fringes apart: of frequencies from 0.2 to 0.6 of the fringes' that is
    nearly the Hilbert transform, which tells what one side band does to the phase by what it does
    to the amplitude.
    """
    slope: Any = cv2.Sobel(nodes, -1, 1, 0, ksize=1, scale=0.5, borderType=cv2.BORDER_REPLICATE)
    return slope


def without_trend(contrast: NDArray[np.float32], windows: Windows) -> NDArray[np.float32]:
    """A contrast's logarithm without what is the lens's and the light's."""
    return contrast - windows.wide_flat_top(contrast, _SMOOTH)


def _finest(field: NDArray[np.float32], windows: Windows) -> NDArray[np.float32]:
    """The finest band of a field, without outliers."""
    fine = field - windows.wide_flat_top(field, SCALES[0])
    limit = np.float32(_OUTLIER * median(np.abs(fine[::3, ::3])))
    return np.clip(fine, -limit, limit)
