"""What the skin's albedo feigns of the phase, told by what else it does to the light.

An albedo that varies as fast as the fringes shifts them. It also leaves light of twice their
frequency, and it changes their contrast, the amplitude over the mean level: neither is a
surface's doing. How much of the phase goes with either, the photograph itself says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.median import median
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows, coarsened
from ftp_dent_ros.profilometry.least_squares.noise.bands import SCALES

# Width of the neighbourhood that is judged over, windows, and the weight of the whole.
_NEIGHBOURHOOD, _GLOBAL = 11.2, 0.1
# Phase that albedo feigns over the sine of twice the phase that it leaves: 2 by theory (albedo
# t = 1 + e sin Phi makes e sin Phi + (e / 2) sin 2 Phi of 1 + cos Phi), more behind a lens that
# shows the double frequency less well.
_MOST_TEXTURE = 5.0
# Phase over the slope of the contrast's logarithm, as a share of that over texture alone: of one
# albedo both bear witness. A third where it is of smooth grains.
_MOST_SLOPE = 0.35
_OUTLIER = 4.5
# The coarsest scale that a contrast's slope is looked at: what is longer is the lens's.
_SMOOTH = SCALES[2]
_LEAST = np.float32(1e-12)


@dataclass(frozen=True)
class Feigned:
    """What of a phase is the albedo's; all at coarse nodes.

    Attributes
    ----------
    on_texture, on_slope : ndarray, shape (rows, columns), float32
        Phase that albedo feigns over texture, with the sign changed, and over the contrast's
        slope.
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
        windows: Windows,
        every: int,
    ) -> Feigned:
        """Regression of the phase's finest band on those of texture and of the contrast's slope.

        Parameters
        ----------
        values, texture : ndarray, shape (rows, columns), float32
            Phase, and the sine of twice the fringes' phase in the light.
        slope : ndarray, shape (rows, columns), float32
            Of the logarithm of the contrast over the phase, without its trend.
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
        alone = np.clip(by_grain / (of_grain + _LEAST), 0, _MOST_TEXTURE)
        determinant = np.maximum(of_grain * of_slope - both * both, 0) + _LEAST * _LEAST
        on_slope = (by_slope * of_grain - both * by_grain) / determinant
        on_slope = np.clip(on_slope, 0, np.float32(_MOST_SLOPE) * alone)
        on_texture = (by_grain - on_slope * both) / (of_grain + _LEAST)
        on_texture = np.clip(on_texture, 0, _MOST_TEXTURE)
        explained = on_texture * (2 * by_grain - on_texture * of_grain - 2 * on_slope * both)
        explained += on_slope * (2 * by_slope - on_slope * of_slope)
        return cls(on_texture, on_slope, np.clip(explained / (energy + _LEAST), 0, 1))


def slope_along_u(nodes: NDArray[np.float32], period: float) -> NDArray[np.float32]:
    """Slope of a field at the nodes along u, over that of the phase of fringes.

    Parameters
    ----------
    nodes : ndarray, shape (rows, columns), float32
    period : float
        Of the fringes, nodes.
    """
    slope: Any = cv2.Sobel(nodes, -1, 1, 0, ksize=1, scale=0.5, borderType=cv2.BORDER_REPLICATE)
    return slope * np.float32(period / (2 * math.pi))


def without_trend(slope: NDArray[np.float32], windows: Windows) -> NDArray[np.float32]:
    """A contrast's slope without what is the lens's and the light's."""
    return slope - windows.wide_flat_top(slope, _SMOOTH)


def _finest(field: NDArray[np.float32], windows: Windows) -> NDArray[np.float32]:
    """The finest band of a field, without outliers."""
    fine = field - windows.wide_flat_top(field, SCALES[0])
    limit = np.float32(_OUTLIER * median(np.abs(fine[::3, ::3])))
    return np.clip(fine, -limit, limit)
