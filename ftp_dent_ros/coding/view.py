"""Whose rays the points of an organised cloud lie on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.rig.rig import Lens


@dataclass(frozen=True)
class View:
    """Whose rays an organised cloud lies on.

    Attributes
    ----------
    lens : Lens
        Of the camera whose frame the cloud is in.
    stride : int
        The cloud has a point at every so many pixels along rows and columns.
    """

    lens: Lens
    stride: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the cloud."""
        return -(-self.lens.height // self.stride), -(-self.lens.width // self.stride)

    @staticmethod
    def of(lens: Lens, rows: int, columns: int) -> View | None:
        """View of a cloud of that size, or None if no stride gives it."""
        stride = max(1, round(lens.width / max(columns, 1)))
        view = View(lens, stride)
        return view if view.shape == (rows, columns) else None

    def numbers(self) -> list[float]:
        """Width, height, f_x, f_y, c_x, c_y, the five of the distortion, stride."""
        matrix = self.lens.camera_matrix
        return [
            *(self.lens.width, self.lens.height),
            *(float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))),
            *map(float, self.lens.distortion),
            self.stride,
        ]

    @staticmethod
    def from_numbers(numbers: Any) -> View:
        """View of its `numbers`; raises `ValueError` or `TypeError` if they are none."""
        width, height, f_x, f_y, c_x, c_y, *distortion, stride = map(float, numbers)
        given = np.array([width, height, f_x, f_y, c_x, c_y, *distortion, stride])
        if len(given) != 12 or not np.isfinite(given).all() or not given[:4].min() > 0:
            raise ValueError('no numbers of a view')
        matrix = np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]])
        if stride < 1:
            raise ValueError('no stride')
        return View(Lens(int(width), int(height), matrix, np.array(distortion)), int(stride))

    def rays(self) -> NDArray[np.float32]:
        """x/z and y/z of each point, shape (2, rows, columns)."""
        return _rays(tuple(self.numbers()))

    def lengths(self) -> NDArray[np.float32]:
        """Distance from the camera over the depth, shape (rows, columns)."""
        return _lengths(tuple(self.numbers()))


@lru_cache(maxsize=4)
def _rays(numbers: tuple[float, ...]) -> NDArray[np.float32]:
    view = View.from_numbers(numbers)
    with np.errstate(all='ignore'):
        rays = view.lens.rays(view.lens.pixel_grid(view.stride))[..., :2]
    return np.ascontiguousarray(np.moveaxis(rays, 2, 0), np.float32)


@lru_cache(maxsize=4)
def _lengths(numbers: tuple[float, ...]) -> NDArray[np.float32]:
    x, y = _rays(numbers)
    return np.sqrt(1 + x * x + y * y)
