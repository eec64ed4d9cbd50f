"""Weighted means over windows: Gaussians, and flat-tops made of two of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.grid import Grid

# Standard deviation of the windows, fringe periods: wider takes depth off small dents, below
# 0.45 the second harmonic of a camera that is not linear comes through.
WIDTH = 0.5
_REACH = 3.6
# A wide Gaussian is computed on a grid so coarse that it is still this wide, nodes.
_LEAST_SIGMA = 1.5
_COARSEST = 8


@dataclass(frozen=True)
class Windows:
    """Windows on the nodes.

    Attributes
    ----------
    sigma_u, sigma_v : float
        Standard deviations, nodes.
    """

    sigma_u: float
    sigma_v: float

    @classmethod
    def for_fringes(cls, period: float, grid: Grid) -> Windows:
        """Windows for fringes of `period` pixels; the nodes' own averages are a part of them."""
        spread = [
            math.sqrt((WIDTH * period) ** 2 - variance) / step
            for step, variance in zip(grid.pitch, grid.node_variance, strict=True)
        ]
        return cls(*spread)

    def gaussian(self, nodes: NDArray, scale: float = 1.0) -> NDArray[np.float32]:
        """Mean weighted by a Gaussian `scale` times as wide as the windows, zero beyond."""
        mean: Any = cv2.sepFilter2D(
            nodes,
            cv2.CV_32F,
            _kernel(scale * self.sigma_u),
            _kernel(scale * self.sigma_v),
            borderType=cv2.BORDER_CONSTANT,
        )
        return mean

    def flat_top(self, nodes: NDArray) -> NDArray[np.float32]:
        """Mean weighted by 2 G_s - G_(sqrt(2) s), which leaves cubics as they are."""
        return 2 * self.gaussian(nodes) - self.gaussian(nodes, math.sqrt(2))

    def wide(
        self, nodes: NDArray, scale: float, border: int = cv2.BORDER_REPLICATE
    ) -> NDArray[np.float32]:
        """Mean weighted by a Gaussian much wider than the windows, on a coarser grid."""
        sigmas = scale * self.sigma_u, scale * self.sigma_v
        steps = [_coarsening(sigma) for sigma in sigmas]
        if max(steps) == 1:
            return blurred(nodes, sigmas, border)
        size = nodes.shape[::-1]
        coarse = [-(-length // step) for length, step in zip(size, steps, strict=True)]
        small = cv2.resize(nodes, coarse, interpolation=cv2.INTER_AREA)
        # What averaging and interpolation blur already.
        left = [
            math.sqrt(sigma * sigma - (step > 1) * (step * step / 4 - 1 / 12)) / step
            for sigma, step in zip(sigmas, steps, strict=True)
        ]
        small = blurred(small, left, border)
        return cv2.resize(small, size, interpolation=cv2.INTER_LINEAR)


def blurred(field: Any, sigmas: Sequence[float], border: int) -> Any:
    """Gaussian of standard deviations along u and v, in samples of the field."""
    return cv2.GaussianBlur(field, (0, 0), sigmaX=sigmas[0], sigmaY=sigmas[1], borderType=border)


def _coarsening(sigma: float) -> int:
    """Nodes that a coarser grid may take together for a Gaussian of `sigma` nodes."""
    step = 1
    while step < _COARSEST and sigma >= 2 * step * _LEAST_SIGMA:
        step *= 2
    return step


@lru_cache(maxsize=64)
def _kernel(sigma: float) -> NDArray[np.float32]:
    reach = math.ceil(_REACH * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return (kernel / kernel.sum()).astype(np.float32)
