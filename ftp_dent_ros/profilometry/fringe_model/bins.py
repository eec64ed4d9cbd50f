"""Bins, means of a few pixels that hold the fringes, and nodes, sums of a few bins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.phase_geometry import PhaseGeometry
from ftp_dent_ros.rig.rig import Rig

# Bins a fringe along u: a fringe is sampled, not averaged away.
_PER_FRINGE = 7.0
# Fringes between nodes along v, and along u at least: windows half a fringe wide change little
# over it.
_PITCH = 0.4
#: Pixel rows of a bin: fewer cost time, more than these are seen as steps.
ROWS = 4, 16

#: Mean square of rounding to whole levels in a bin, levels^2.
ROUNDING = 0.05
#: Standard deviation of the Gaussian windows, fringes: below 0.45 level and contrast of a cosine
#: are no longer apart.
WIDTH = 0.5


@dataclass(frozen=True)
class BinGrid:
    """Bins and nodes of an image of fringes of some period.

    Attributes
    ----------
    width, height : int
        Of the image, pixels.
    period : float
        Of the fringes, pixels.
    step, rows : int
        Pixels of a bin along u and v.
    node : int
        Bins of a node along u; along v a node is a bin.
    """

    width: int
    height: int
    period: float
    step: int
    rows: int
    node: int

    @classmethod
    def of(cls, width: int, height: int, period: float) -> BinGrid:
        """Grid for fringes of `period` pixels."""
        step = max(1, round(period / _PER_FRINGE))
        high = round(_PITCH * period)
        rows, node = int(np.clip(high, *ROWS)), max(2, math.ceil(high / step))
        return cls(width, height, float(period), step, rows, node)

    @cached_property
    def node_shape(self) -> tuple[int, int]:
        """Rows and columns of nodes."""
        return -(-self.height // self.rows), -(-self.width // (self.step * self.node))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of bins."""
        rows, columns = self.node_shape
        return rows, columns * self.node

    @cached_property
    def fringe(self) -> tuple[float, float]:
        """Bins a fringe is wide, along u and v."""
        return self.period / self.step, self.period / self.rows

    def part(self, rows: slice, nodes: slice) -> BinGrid:
        """Grid of some rows and nodes of this one."""
        width = (nodes.stop - nodes.start) * self.node * self.step
        return replace(self, width=width, height=(rows.stop - rows.start) * self.rows)

    def bin_positions(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel columns and rows of the bins' centres."""
        rows, columns = self.shape
        return _centres(columns, self.step), _centres(rows, self.rows)

    def node_positions(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel columns and rows of the nodes' centres."""
        rows, columns = self.node_shape
        return _centres(columns, self.step * self.node), _centres(rows, self.rows)

    def places(self, columns, rows):
        """Crossings of pixel columns and rows over the width: x and y that broadcast."""
        return columns[None] / self.width, rows[:, None] / self.width

    @cached_property
    def bin_places(self):
        """Places of the bins."""
        return self.places(*self.bin_positions())

    @cached_property
    def across(self) -> NDArray[np.float32]:
        """Columns of the bins, from -0.5 to 0.5 over the width."""
        return np.linspace(-0.5, 0.5, self.shape[1], dtype=np.float32)

    @cached_property
    def node_places(self):
        """Places of the nodes."""
        return self.places(*self.node_positions())

    def binned(self, plane: NDArray[Any]) -> NDArray[np.float32]:
        """Means of a plane of pixels over the bins."""
        rows, columns = self.shape
        below, right = rows * self.rows - self.height, columns * self.step - self.width
        whole = cv2.copyMakeBorder(plane, 0, below, 0, right, cv2.BORDER_REPLICATE)
        strips: Any = whole.reshape(rows, self.rows, -1)
        return _means(strips.sum(axis=1, dtype=np.float32), self.step) / self.rows

    def at_nodes(self, bins: NDArray[np.float32]) -> NDArray[np.float32]:
        """Means of bins over the nodes."""
        return _means(bins, self.node)

    def at_bins(self, nodes: NDArray[np.float32]) -> Any:
        """Values at the nodes, interpolated to the bins."""
        return cv2.resize(nodes, self.shape[::-1], interpolation=cv2.INTER_LINEAR)

    def at_pixels(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values at the nodes or bins, interpolated to the pixels."""
        rows, columns = self.shape
        size = columns * self.step, rows * self.rows
        pixels: Any = cv2.resize(values, size, interpolation=cv2.INTER_LINEAR)
        return pixels[: self.height, : self.width]

    def repeated(self, nodes: NDArray[Any]) -> NDArray[Any]:
        """Values at the nodes, each for all of its bins."""
        return np.repeat(nodes, self.node, axis=1)

    def within(self, nodes: NDArray[np.bool_], fringes: float) -> NDArray[np.bool_]:
        """What is within so many fringes of nodes."""
        along_u, along_v = self.fringe
        return dilated(nodes, *(math.ceil(fringes * n) for n in (along_v, along_u / self.node)))

    def window_sums(self, bins: NDArray[np.float32]) -> NDArray[np.float32]:
        """Means of bins under the windows about the nodes; there is nothing beyond the image."""
        return self.smooth_nodes(self.at_nodes(bins), WIDTH)

    def smooth_nodes(
        self, nodes: NDArray[np.float32], fringes: float, along_v: float | None = None
    ) -> NDArray[np.float32]:
        """Gaussian of so many fringes over values at the nodes; of others along v if given."""
        both = fringes, fringes if along_v is None else along_v
        sigmas = both[0] * self.fringe[0] / self.node, both[1] * self.fringe[1]
        # Wide Gaussians see no more on a coarser grid: there some twice as wide as the windows.
        coarse = [2 ** max(math.frexp(each / (2 * WIDTH))[1] - 1, 0) for each in both]
        return smoothed(nodes, sigmas, coarse)

    def around(self, bins: NDArray[np.float32]) -> Any:
        """Means over half a fringe about the bins."""
        return cv2.blur(bins, self.half_fringe)

    @property
    def half_fringe(self) -> tuple[int, int]:
        """Bins of half a fringe along u and v, odd numbers."""
        u, v = self.fringe
        return max(3, round(u / 2) | 1), max(3, round(v) | 1)

    @property
    def bins_in_window(self) -> float:
        """Bins that count in a window: those of one of even weights with the same variance."""
        along_u, along_v = self.fringe
        return 4 * np.pi * WIDTH**2 * along_u * along_v


@dataclass(frozen=True, eq=False)
class GridGeometry:
    """A grid, and what the projector shows along the rays of its bins and nodes."""

    grid: BinGrid
    bins: PhaseGeometry
    nodes: PhaseGeometry

    @classmethod
    def of(cls, rig: Rig, pattern: Pattern, grid: BinGrid) -> GridGeometry:
        """Geometry of a rig and pattern."""
        places = grid.bin_positions(), grid.node_positions()
        return cls(grid, *(PhaseGeometry.of(rig, pattern, *each) for each in places))


def deconvolved(means: NDArray[np.float32], along_u: int, along_v: int) -> NDArray[np.float32]:
    """Means of so many samples, such that linear interpolation leaves bends as they are.

    The mean of n samples and the interpolation between means smooth by (n^2 - 1) / 4 in all.
    """
    u, v = (
        np.array([-each, 1 + 2 * each, -each])
        for each in ((1 - n**-2) / 8 for n in (along_u, along_v))
    )
    sharp: Any = cv2.sepFilter2D(means, -1, u, v, borderType=cv2.BORDER_REPLICATE)
    return sharp


class Nearest:
    """Fills what is not known with the nearest that is.

    Parameters
    ----------
    known : ndarray of bool, shape (rows, columns)
    """

    def __init__(self, known: NDArray[np.bool_]) -> None:
        self._unknown = np.flatnonzero(~known) if known.any() else np.zeros(0, np.intp)
        self._source = self._unknown
        if len(self._unknown):
            away: Any = (~known).view(np.uint8)
            _, label = cv2.distanceTransformWithLabels(
                away, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
            )
            # Labels number what is known, row by row, from 1 on.
            self._source = np.flatnonzero(known)[label.ravel()[self._unknown] - 1]

    def __call__(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values with the nearest known one where none is known."""
        filled = values.copy()
        np.put(filled, self._unknown, values.ravel()[self._source])
        return filled


def moved(values: NDArray[Any], columns: int, rows: int) -> Any:
    """The value so far to the right and below, at the border the border's."""
    down, right = abs(rows), abs(columns)
    wide = cv2.copyMakeBorder(values, down, down, right, right, cv2.BORDER_REPLICATE)
    height, width = values.shape
    return wide[down + rows : down + rows + height, right + columns : right + columns + width]


def dilated(nodes: NDArray[np.bool_], rows: int, columns: int) -> NDArray[np.bool_]:
    """What is within so many rows and columns of nodes."""
    box = np.ones((2 * rows + 1, 2 * columns + 1), np.uint8)
    near: NDArray[np.bool_] = cv2.dilate(nodes.view(np.uint8), box) > 0
    return near


def wider_than_windows(nodes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without strips that are thinner than a window: those are the rim of what is beside them."""
    wide: Any = cv2.morphologyEx(nodes.view(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return wide > 0


def _means(values: NDArray[np.float32], count: int) -> Any:
    """Means of so many columns side by side.

    By pairs, which takes less time than OpenCV's areas; two pairs are a pair of complex numbers.
    """
    total, left = values.astype(np.float32, copy=False), count
    while left % 2 == 0:
        pairs = total.view(np.float32 if left % 4 else np.complex64)
        total, left = (pairs[:, ::2] + pairs[:, 1::2]).view(np.float32), left // 2
    return sum(total[:, place::left] for place in range(left)) * np.float32(1 / count)


def smoothed(values: Any, sigmas: Sequence[float], coarse: Sequence[int]) -> Any:
    """Gaussian along u and v on a grid so many times as coarse; beyond the values is nothing."""
    if max(coarse) > 1:
        size = values.shape[::-1]
        few = [-(-n // each) for n, each in zip(size, coarse, strict=True)]
        sigmas = [each * n / of for each, n, of in zip(sigmas, few, size, strict=True)]
        low = smoothed(cv2.resize(values, few, interpolation=cv2.INTER_AREA), sigmas, (1, 1))
        return cv2.resize(low, size, interpolation=cv2.INTER_LINEAR)
    # Beyond three deviations hardly anything counts.
    box = [2 * math.ceil(3 * each) + 1 for each in sigmas]
    return cv2.GaussianBlur(
        values, box, sigmaX=sigmas[0], sigmaY=sigmas[1], borderType=cv2.BORDER_CONSTANT
    )


def _centres(count: int, pitch: int) -> NDArray[np.float64]:
    return pitch * np.arange(count, dtype=float) + (pitch - 1) / 2
