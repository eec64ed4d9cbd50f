"""What the outside renderer's worlds are made of: dents, screens, and what rays meet."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dimple:
    """A dent in the skin, ``depth 10^(-r^2)``: its axes are those at 10 % of the depth, metres."""

    x: float
    y: float
    length: float
    width: float
    depth: float
    angle: float = 0.0

    def height(self, x: Array, y: Array) -> Array:
        """Depth at places, along the camera's axis."""
        along = math.cos(self.angle) * (x - self.x) + math.sin(self.angle) * (y - self.y)
        across = math.cos(self.angle) * (y - self.y) - math.sin(self.angle) * (x - self.x)
        square = (2 * along / self.length) ** 2 + (2 * across / self.width) ** 2
        return self.depth * np.exp(-math.log(10) * np.minimum(square, 60))


@dataclass(frozen=True)
class Screen:
    """Something thin before the skin: metres from the camera, where it is, and its albedo."""

    distance: float
    covers: Callable[[Array, Array], NDArray[np.bool_]]
    albedo: float = 0.5


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays meet: points and unit vectors of shape (n, 3), the rest (n,)."""

    points: Array
    normals: Array
    view: Array
    lamp: Array
    squared_distance: Array
    u: Array
    v: Array
    rows: Array
    moment: Array | float

    def half(self) -> Array:
        """Cosine between the normal and the mirror of lamp and camera."""
        middle = self.view + self.lamp
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        return np.clip(np.einsum('ij,ij->i', middle, self.normals), 0, 1)
