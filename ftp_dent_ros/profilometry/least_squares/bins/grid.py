"""Bins and nodes: the coarse grids that least squares works on, and the way back to pixels.

Bins are averages of a few pixels, fine enough to hold the fringes; nodes, two bins wide, are
fine enough to hold what is left of them after demodulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.averages import boxes, weights_in_blocks

# Pixels a bin holds along v, along which the fringes hardly change: as a share of a fringe.
_LEAST_ROWS, _MOST_ROWS = 4, 6
_ROWS = 0.85
# Fringes between nodes along u, about.
_PITCH = 0.6
# Bins a fringe must at least have.
_PER_FRINGE = 4.6
# Boxes that average pixels to bins, one over the other: an odd number.
_ORDER = 5
_NODE_ORDER = 3
# A lattice has every second pixel along u: cubics through four keep its fringes off those of
# half the sampling frequency beyond, which averages alone let through by a two-hundredth.
_BETWEEN = np.array([-1, 0, 9, 16, 9, 0, -1]) / 16


@dataclass(frozen=True)
class Grid:
    """Bins and nodes over an image.

    Attributes
    ----------
    width, height : int
        Of the image, pixels.
    step : int
        Pixels a bin holds along u.
    bins : int
        Bins a node holds along u.
    rows : int
        Pixels a bin holds along v.
    """

    width: int
    height: int
    step: int
    bins: int
    rows: int = _LEAST_ROWS

    @classmethod
    def for_fringes(cls, width: int, height: int, period: float) -> Grid:
        """Grid for fringes of `period` pixels."""
        step = max(1, int(period / _PER_FRINGE))
        rows = min(max(int(_ROWS * period), _LEAST_ROWS), _MOST_ROWS)
        pitch = _PITCH * period
        return cls(width, height, step, max(2, int(pitch / step)), rows)

    @property
    def pitch(self) -> tuple[int, int]:
        """Pixels between nodes along u and v."""
        return self.bins * self.step, self.rows

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of nodes."""
        along_u, along_v = self.pitch
        return -(-self.height // along_v), -(-self.width // along_u)

    @property
    def bin_shape(self) -> tuple[int, int]:
        """Rows and columns of bins."""
        rows, columns = self.shape
        return rows, self.bins * columns

    def node_positions(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel columns and rows of the nodes' centres."""
        rows, columns = self.shape
        return _centres(columns, self.pitch[0]), _centres(rows, self.pitch[1])

    def bin_positions(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel columns and rows of the bins' centres."""
        rows, columns = self.bin_shape
        return _centres(columns, self.step), _centres(rows, self.pitch[1])

    @property
    def bin_variance(self) -> float:
        """Of the averages over pixels along u that bins are."""
        return _ORDER * (self.step**2 - 1) / 12

    def binned(self, plane: NDArray) -> NDArray[np.float32]:
        """Averages of a plane of pixels over the bins, shape `bin_shape`, float32."""
        rows, columns = self.bin_shape
        missing = rows * self.rows - self.height, columns * self.step - self.width
        if any(missing):
            plane = cv2.copyMakeBorder(plane, 0, missing[0], 0, missing[1], cv2.BORDER_REPLICATE)
        mean: Any = np.zeros((rows, plane.shape[1]), np.float32)
        for row in range(self.rows):
            cv2.accumulate(plane[row :: self.rows], mean)
        mean *= np.float32(1 / self.rows)
        if self.step == 1:
            return mean
        return self._averaged_along_u(mean, boxes(self.step, _ORDER))

    def binned_lattice(
        self, mosaic: NDArray, first_row: int, first_column: int
    ) -> NDArray[np.float32]:
        """Averages over the bins of every second pixel of every second row alone.

        Their centres of gravity are those of all pixels of the bins: along u since averages over
        averages leave nothing of what alternates, along v by a share of the bin beside.

        Parameters
        ----------
        mosaic : ndarray, shape (height, width)
        first_row, first_column : int
            0 or 1, of the pixels that count.
        """
        rows, columns = self.bin_shape
        missing = rows * self.rows - self.height, columns * self.step - self.width
        if any(missing):
            # Mirrored about the last pixel, rows and columns stay odd or even.
            mosaic = cv2.copyMakeBorder(
                mosaic, 0, missing[0], 0, missing[1], cv2.BORDER_REFLECT_101
            )
        lines = mosaic[:, first_column::2].reshape(rows, self.rows, -1)
        mean = np.empty((rows, lines.shape[2]), np.float32)
        odd = self.rows % 2
        for parity in range(1 + odd):
            some = slice(parity, None, 1 + odd)
            chosen = range((first_row + parity * odd) % 2, self.rows, 2)
            total = np.zeros(mean[some].shape, np.uint32)
            for row in chosen:
                total += lines[some, row]
            mean[some] = total * np.float32(1 / len(chosen))
        if not odd:
            away = np.float32((0.5 - first_row) / self.rows)
            padded = np.pad(mean, ((1, 1), (0, 0)), 'edge')
            beside = padded[2:] if away > 0 else padded[:-2]
            mean += abs(away) * (beside - mean)
        sparse = np.zeros((rows + 1, columns * self.step), np.float32)
        sparse[:-1, first_column::2] = mean
        sparse[-1, first_column::2] = 1
        taps = np.convolve(_BETWEEN, boxes(self.step, _ORDER))
        averages = self._averaged_along_u(sparse, taps)
        return averages[:-1] / averages[-1]

    def _averaged_along_u(self, lines, taps) -> NDArray[np.float32]:
        """Means, weighted by `taps`, of pixels around the centres of the bins along u."""
        anchor = ((len(taps) - 1) // 2, 0)
        fine: Any = cv2.sepFilter2D(
            lines, -1, taps, np.ones(1), anchor=anchor, borderType=cv2.BORDER_REFLECT_101
        )
        return np.ascontiguousarray(fine[:, (self.step - 1) // 2 :: self.step])

    def noise_at(self, period: float) -> tuple[float, float]:
        """What averaging leaves of the pixels' white noise of variance 1.

        Returns
        -------
        variance : float
            Of the bins.
        density : float
            Power density at `period` bins, over the mean of all: averages are not white.
        """
        taps = boxes(self.step, _ORDER)
        turn = 2 * np.pi / (self.step * period) * np.arange(len(taps))
        power = np.square(taps @ np.cos(turn)) + np.square(taps @ np.sin(turn))
        square = np.square(taps).sum()
        return float(square / self.rows), float(power / (self.step * square))

    def to_bins(self, nodes: NDArray) -> NDArray:
        """Values at the nodes, repeated for each of their bins."""
        # OpenCV's channels take a seventh of the time of NumPy's repetition.
        kind = np.uint8 if nodes.dtype == bool else nodes.dtype
        bins: Any = cv2.merge([nodes.view(kind)] * self.bins)
        return bins.reshape(len(nodes), -1).view(nodes.dtype)

    def at_nodes(self, bins: NDArray[np.float32]) -> NDArray[np.float32]:
        """Averages of bins over the nodes, along the last axis."""
        columns = bins.shape[-1]
        rows = bins.reshape(-1, columns)
        result = np.empty((len(rows), columns // self.bins), np.float32)
        # Products of matrices decimate as they average.
        for nodes, needed, weights in weights_in_blocks(self.bins, columns, _NODE_ORDER):
            np.matmul(rows[:, needed], weights, out=result[:, nodes])
        return result.reshape(*bins.shape[:-1], -1)

    @property
    def node_variance(self) -> tuple[float, float]:
        """Of the averages over pixels that nodes are, along u and v."""
        along_u = _NODE_ORDER * (self.bins**2 - 1) / 12 * self.step**2
        return along_u, (self.rows**2 - 1) / 12

    def at_bins(self, nodes: NDArray) -> NDArray:
        """Values at nodes of some rows, interpolated to the bins, extrapolated to outer ones."""
        size = self.bin_shape[1], len(nodes)
        values: Any = cv2.resize(nodes, size, interpolation=cv2.INTER_LINEAR)
        if nodes.shape[1] > 1:
            outer = self.bins // 2
            away = ((self.bins - 1) / 2 - np.arange(outer, dtype=np.float32)) / self.bins
            for end, inner, place, share in (
                (0, 1, slice(None, outer), away),
                (-1, -2, slice(-outer, None), away[::-1]),
            ):
                slope = nodes[:, end, None] - nodes[:, inner, None]
                values[:, place] = nodes[:, end, None] + share * slope
        return values


def _centres(count: int, pitch: int) -> NDArray[np.float64]:
    return pitch * np.arange(count, dtype=float) + (pitch - 1) / 2
