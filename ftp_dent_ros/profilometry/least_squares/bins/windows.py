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

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid

# Standard deviation of the windows, fringe periods: wider takes depth off small dents, below
# 0.45 the second harmonic of a camera that is not linear comes through.
WIDTH = 0.5
# Standard deviation of a window that is no average, nodes or bins.
NO_AVERAGE = 1e-3
_REACH, _REACH_OF_WIDE = 3.6, 3.0
# A wide Gaussian is computed on a grid so coarse that it is still this wide, nodes.
_LEAST_SIGMA = 1.5
_COARSEST = 8
# Standard deviations of a window within which the first fit takes a rim for fringes.
_SEEN = 3.3


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
        sigmas = scale * self.sigma_u, scale * self.sigma_v
        return gaussian_of(nodes, *sigmas, cv2.BORDER_CONSTANT)

    def along_u(self, nodes: NDArray) -> NDArray[np.float32]:
        """As `gaussian`, along u alone."""
        mean: Any = cv2.sepFilter2D(
            nodes,
            cv2.CV_32F,
            _kernel(self.sigma_u),
            np.ones(1, np.float32),
            borderType=cv2.BORDER_CONSTANT,
        )
        return mean

    def along_v(self, nodes: NDArray, scale: float) -> NDArray[np.float32]:
        """Mean weighted by a Gaussian `scale` times as wide as the windows, along v alone."""
        along_u = np.ones(1, np.float32)
        mean: Any = cv2.sepFilter2D(
            nodes, -1, along_u, _kernel(scale * self.sigma_v), borderType=cv2.BORDER_REPLICATE
        )
        return mean

    def flat_top(self, nodes: NDArray) -> NDArray[np.float32]:
        """Mean weighted by 2 G_s - G_(sqrt(2) s), which leaves cubics as they are."""
        return 2 * self.gaussian(nodes) - self.gaussian(nodes, math.sqrt(2))

    def wide(self, nodes: NDArray, scale: float) -> NDArray[np.float32]:
        """Mean weighted by a Gaussian much wider than the windows, on a coarser grid."""
        steps, (sigmas,) = _coarse(self, scale, (1.0,))
        small = blurred(coarsened(nodes, steps), sigmas, cv2.BORDER_REPLICATE)
        return interpolated(small, nodes.shape)

    def wide_flat_top(self, nodes: NDArray, scale: float) -> NDArray[np.float32]:
        """As `flat_top`, of Gaussians much wider than the windows, on a coarser grid."""
        steps, sigmas = _coarse(self, scale, (1.0, math.sqrt(2)))
        small = coarsened(nodes, steps)
        narrow, broad = (blurred(small, each, cv2.BORDER_REPLICATE) for each in sigmas)
        return interpolated(2 * narrow - broad, nodes.shape)


def gaussian_of(
    nodes: NDArray, sigma_u: float, sigma_v: float, border: int
) -> NDArray[np.float32]:
    """Mean weighted by a Gaussian of standard deviations in nodes."""
    kernels = _kernel(sigma_u), _kernel(sigma_v)
    mean: Any = cv2.sepFilter2D(nodes, cv2.CV_32F, *kernels, borderType=border)
    return mean


def coarsened(nodes: NDArray, steps: Sequence[int]) -> Any:
    """Averages over so many nodes along u and v; the nodes themselves if that is one."""
    if max(steps) == 1:
        return nodes
    size = [-(-length // step) for length, step in zip(nodes.shape[::-1], steps, strict=True)]
    halved = sorted(steps) == [1, 2] and nodes.size == 2 * size[0] * size[1]
    # Of two values the line through them has the mean in between, in a third of the time.
    way = cv2.INTER_LINEAR if halved else cv2.INTER_AREA
    return cv2.resize(nodes, size, interpolation=way)


def interpolated(small: Any, shape: tuple[int, ...]) -> Any:
    """Such averages, interpolated to nodes of a shape."""
    if small.shape == shape:
        return small
    return cv2.resize(small, shape[::-1], interpolation=cv2.INTER_LINEAR)


def blurred(field: Any, sigmas: Sequence[float], border: int) -> Any:
    """Gaussian of standard deviations along u and v, in samples of the field."""
    along_u, along_v = (_kernel(sigma, _REACH_OF_WIDE) for sigma in sigmas)
    return cv2.sepFilter2D(field, -1, along_u, along_v, borderType=border)


def sighted(region: NDArray[np.bool_], windows: Windows) -> NDArray[np.bool_]:
    """The nodes of a region whose first fit is free of its rim; all of it if there are none."""
    size = [2 * math.ceil(_SEEN * sigma) + 1 for sigma in (windows.sigma_v, windows.sigma_u)]
    inner = cv2.erode(region.view(np.uint8), np.ones(size, np.uint8), borderValue=0) > 0
    return inner if inner.any() else region


@lru_cache(maxsize=256)
def _coarse(
    windows: Windows, scale: float, wider: tuple[float, ...]
) -> tuple[list[int], list[list[float]]]:
    """Nodes along u and v that a coarser grid takes together for a Gaussian.

    And standard deviations on that grid of Gaussians so many times as wide, less what averaging
    and interpolation blur already.
    """
    sigmas = windows.sigma_u, windows.sigma_v
    steps = [_coarsening(scale * sigma) for sigma in sigmas]
    left = [
        [
            math.sqrt((each * scale * sigma) ** 2 - (step > 1) * (step * step / 4 - 1 / 12)) / step
            for sigma, step in zip(sigmas, steps, strict=True)
        ]
        for each in wider
    ]
    return steps, left


def _coarsening(sigma: float) -> int:
    """Nodes that a coarser grid may take together for a Gaussian of `sigma` nodes."""
    step = 1
    while step < _COARSEST and sigma >= 2 * step * _LEAST_SIGMA:
        step *= 2
    return step


@lru_cache(maxsize=64)
def _kernel(sigma: float, reach: float = _REACH) -> NDArray[np.float32]:
    most = math.ceil(reach * sigma)
    kernel = np.exp(-0.5 * (np.arange(-most, most + 1) / sigma) ** 2)
    return (kernel / kernel.sum()).astype(np.float32)
