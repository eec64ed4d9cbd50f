"""A dent as a height field over a panel: eq. 18, or another shape, scaled, turned and moved.

Heights are along the panel's z axis, which points into the aircraft: a dent is positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.skin.fields import require_positive
from ftp_dent_ros.simulation.skin.placing import turned
from ftp_dent_ros.simulation.skin.shapes import SMOOTH, Shape

# Directions in which a contour is followed, and its points on a ray that find its outermost
# crossing; halving the bracket so often leaves 1e-12 of the axes.
DIRECTIONS = 720
_ALONG_A_RAY = 400
_HALVINGS = 32

# From this part of the depth on a mark is whole.
_MARKED = 0.3

Field = NDArray[np.float64]


@dataclass(frozen=True)
class Dent:
    """A dent, crease, gouge or bulge.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    length, width : float
        Full axes of the ellipse (or box) that the shape fills: outside it a shape with a border
        is zero, metres.
    depth : float
        Deepest point, metres; positive is pushed in, negative a bulge.
    angle : float
        From the panel's x axis to the dent's length, towards y, radians.
    shape : Shape
        Eq. 18 if left out.
    mark : float
        Factor on the paint's albedo at the bottom: a gouge's is light or dark.
    """

    x: float
    y: float
    length: float
    width: float
    depth: float
    angle: float = 0.0
    shape: Shape = SMOOTH
    mark: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self, 'length', 'width')

    @property
    def kind(self) -> str:
        """What an inspector calls it: its shape's kind, or ``'bump'``."""
        return self.shape.kind if self.depth > 0 else 'bump'

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds the dent, metres."""
        return self.shape.border * max(self.length, self.width) / 2

    @property
    def rise(self) -> float:
        """Largest height above or below the skin, metres."""
        return abs(self.depth)

    def covers(self, x: Field, y: Field, margin: float | Field = 0.0) -> NDArray[np.bool_]:
        """Mask of panel coordinates where the dent, widened by `margin` metres, is not zero."""
        u, v = self._normalised(x, y)
        shortest = min(self.length, self.width) / 2
        return u * u + v * v < (self.shape.border + margin / shortest) ** 2

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        u, v = self._normalised(x, y)
        part, along_u, along_v = self.shape.fraction(u, v)
        slope_u = along_u * (2 * self.depth / self.length)
        slope_v = along_v * (2 * self.depth / self.width)
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.depth * part, slope_u * c - slope_v * s, slope_u * s + slope_v * c

    def clean(self, x: Field, y: Field) -> Field:
        """Factor on the paint's albedo at panel coordinates."""
        u, v = self._normalised(x, y)
        return 1 + (self.mark - 1) * np.clip(self.shape.fraction(u, v)[0] / _MARKED, 0, 1)

    def size_at(self, level: float = 0.1) -> tuple[float, float]:
        """Length and width of the contour at a fraction `level` of the depth, metres.

        The length is the longest distance across it, the width the longest at 90 degrees to that.
        """
        points = self.outline(level)
        return size_of(points)

    def outline(self, level: float = 0.1) -> Field:
        """Contour at a fraction `level` of the depth, from the centre, shape (720, 2), metres."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        u, v = _contour(self.shape, level) / 2
        along, across = u * self.length, v * self.width
        return np.stack([c * along - s * across, s * along + c * across], axis=-1)

    def _normalised(self, x: Field, y: Field) -> tuple[Field, Field]:
        along, across = turned(x - self.x, y - self.y, self.angle)
        return along / (self.length / 2), across / (self.width / 2)


def size_of(points: Field) -> tuple[float, float]:
    """Longest distance across points of shape (n, 2), and their extent at 90 degrees to it."""
    apart = points[:, None] - points[None]
    square = np.sum(apart * apart, axis=-1)
    first, second = np.unravel_index(np.argmax(square), square.shape)
    length = math.sqrt(square[first, second])
    along_x, along_y = apart[first, second] / length
    across = points @ np.array([-along_y, along_x])
    return length, float(np.ptp(across))


@lru_cache(maxsize=256)
def _contour(shape: Shape, level: float) -> Field:
    """Outermost normalised points (u, v) at a fraction of the depth, shape (2, directions)."""
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    direction = np.stack([np.cos(angles), np.sin(angles)])
    radii = np.linspace(0, shape.border, _ALONG_A_RAY)
    u, v = radii[:, None] * direction[:, None]
    above = shape.fraction(u, v)[0] > level
    last = _ALONG_A_RAY - 1 - np.argmax(above[::-1], axis=0)
    low, high = radii[last], radii[np.minimum(last + 1, _ALONG_A_RAY - 1)]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        inside = shape.fraction(*(middle * direction))[0] > level
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return direction * low
