"""A deviation around one dent, resampled to a metric grid on the contour."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.robust import median

Map = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Patch:
    """Depths on a square grid of the contour's x and y.

    Attributes
    ----------
    corner : tuple of 2 floats
        x, y of the first cell's centre, metres.
    step : float
        Between cells, metres.
    depth : ndarray, shape (rows, columns)
        Smoothed, metres; 0 where not `known`.
    known : ndarray, shape (rows, columns), bool
        Where points lie close enough.
    scale : float
        Of the smoothing, metres.
    stated : ndarray, shape (rows, columns)
        Noise of the points beyond the common one, as they were before the smoothing, metres.
    """

    corner: tuple[float, float]
    step: float
    depth: Map
    known: Mask
    scale: float
    stated: Map

    @classmethod
    def of(
        cls,
        x: Map,
        y: Map,
        depth: Map,
        stated: Map,
        bounds: tuple[float, float, float, float],
        step: float,
        scale: float,
    ) -> Patch:
        """Resample scattered depths, each of shape (n,), within (x_min, x_max, y_min, y_max).

        Of the depths, a Gaussian mean of standard deviation `scale` and, once more, that of what
        it left over: together they keep a surface's curvature.
        """
        x_min, x_max, y_min, y_max = bounds
        columns = math.ceil((x_max - x_min) / step) + 1
        rows = math.ceil((y_max - y_min) / step) + 1
        at_x, at_y = (x - x_min) / step, (y - y_min) / step
        inside = (at_x > 0) & (at_x < columns - 1) & (at_y > 0) & (at_y < rows - 1)
        at_x, at_y, depth, stated = (each[inside] for each in (at_x, at_y, depth, stated))
        splat = _Splat(at_x, at_y, (rows, columns))
        sigma = math.hypot(scale / step, 1e-6)
        size = 2 * math.ceil(3 * sigma) + 1

        def blur(values: Map) -> Map:
            result = cv2.GaussianBlur(values, (size, size), sigma, borderType=cv2.BORDER_CONSTANT)
            return np.asarray(result, float)

        weight = blur(splat.add(np.ones_like(depth)))
        # At a straight rim half of the weight is left.
        known = weight > 0.45 * median(weight[weight > 0.3 * weight.max(initial=0)])
        divisor = np.maximum(weight, 1e-9)
        first = blur(splat.add(depth)) / divisor
        over = depth - splat.take(first)
        return cls(
            (x_min, y_min),
            step,
            np.where(known, first + blur(splat.add(over)) / divisor, 0.0),
            known,
            scale,
            blur(splat.add(stated)) / divisor,
        )

    @cached_property
    def single(self) -> NDArray[np.float32]:
        """The depths in the precision that they are sampled in."""
        return self.depth.astype(np.float32)

    @cached_property
    def x(self) -> Map:
        """Positions of the columns, metres."""
        return self.corner[0] + self.step * np.arange(self.depth.shape[1], dtype=float)

    @cached_property
    def y(self) -> Map:
        """Positions of the rows, metres."""
        return self.corner[1] + self.step * np.arange(self.depth.shape[0], dtype=float)

    def cells(self, x: Map, y: Map) -> tuple[Map, Map]:
        """Columns and rows of positions, fractions of cells."""
        return (x - self.corner[0]) / self.step, (y - self.corner[1]) / self.step

    def at(self, x: Map, y: Map) -> Map:
        """Depth at positions, bicubic."""
        return sampled(self.single, *self.cells(x, y), cv2.INTER_CUBIC)

    def is_known(self, x: Map, y: Map) -> Mask:
        """Whether positions are measured."""
        return sampled(self.known.view(np.uint8), *self.cells(x, y), cv2.INTER_NEAREST) > 0.5


def sampled(values: NDArray, columns: Map, rows: Map, interpolation: int) -> Map:
    """Values at fractions of cells, 0 beyond the frame; any shape of up to 2 dimensions."""
    x, y = np.float32(columns), np.float32(rows)
    if x.ndim < 2:
        x, y = np.atleast_2d(x), np.atleast_2d(y)
    if values.dtype != np.uint8:
        values = values.astype(np.float32, copy=False)
    found = cv2.remap(values, x, y, interpolation, borderMode=cv2.BORDER_CONSTANT)
    return found.astype(float).reshape(np.shape(columns))


class _Splat:
    """Bilinear weights between scattered points and a grid."""

    def __init__(self, at_x: Map, at_y: Map, shape: tuple[int, int]) -> None:
        column, row = at_x.astype(np.intp), at_y.astype(np.intp)
        u, v = at_x - column, at_y - row
        first = row * shape[1] + column
        self._shape = shape
        at = np.array([first, first + 1, first + shape[1], first + shape[1] + 1])
        self._at = at.ravel()
        self._weight = np.array([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])

    def add(self, values: Map) -> Map:
        count = self._shape[0] * self._shape[1]
        total = np.bincount(self._at, (self._weight * values).ravel(), count)
        return np.asarray(total, float).reshape(self._shape)

    def take(self, grid: Map) -> Map:
        near = grid.ravel()[self._at].reshape(self._weight.shape)
        return (self._weight * near).sum(axis=0)
