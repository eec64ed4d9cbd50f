"""Dents and rivets as height fields over a panel; dents of eq. 18, or another shape.

Heights are along the panel's z axis, which points into the aircraft: what stands out is negative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.fields import Checked, Limits, Positive, Share

# exp(1 - 1/q) is below 1e-300 here, and its slope does not overflow.
_RIM = 1.4e-3

Field = NDArray[np.float64]

# Directions in which a contour is followed, and its points on a ray that find its outermost
# crossing; halving the bracket so often leaves 1e-12 of the axes.
DIRECTIONS = 720
_ALONG_A_RAY = 400
# Of the depth, where sizes are measured.
_LEVEL = 0.1


def turned(x: NDArray[Any], y: NDArray[Any], angle: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Coordinates along and across a direction.

    Parameters
    ----------
    x, y : ndarray
        On the panel from the part's centre, of any shape and floating-point type.
    angle : float
        From the panel's x axis to the direction, towards y, radians.

    Returns
    -------
    along, across : ndarray
        Of the same shape and type.
    """
    c, s = math.cos(angle), math.sin(angle)
    return x * c + y * s, y * c - x * s


@dataclass(frozen=True)
class Shape(Checked):
    """What a dent's height is, as a part of its depth: of the distance r from the middle alone.

    Attributes
    ----------
    kind : str
        What an inspector calls it: ``'dent'``, ``'crease'`` or ``'gouge'``.
    border : float
        Distance from the middle beyond which it is 0.
    """

    kind = 'dent'
    border = 1.0

    def fraction(self, u: Field, v: Field) -> tuple[Field, Field, Field]:
        """Part of the depth, and its derivatives along `u` and `v`."""
        value, slope = self.profile(u * u + v * v)
        return value, 2 * u * slope, 2 * v * slope

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        raise NotImplementedError


class Smooth(Shape):
    """Eq. 18, over its maximum: ``exp(1 - 1 / (1 - r^2))``."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        q = np.maximum(1 - square, _RIM)
        value = np.where(q > _RIM, np.exp(1 - 1 / q), 0.0)
        return value, -value / (q * q)


class RaisedCosine(Shape):
    """``(1 + cos(pi r)) / 2``."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        r = np.sqrt(np.minimum(square, 1))
        return (1 + np.cos(math.pi * r)) / 2, -(math.pi**2) / 4 * np.sinc(r)


class Gaussian(Shape):
    """``10^(-r^2)``, as hail leaves: without a border, its axes are those at 10 % of the depth."""

    border = 3.0

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        value = np.where(square < self.border**2, np.exp(-math.log(10) * square), 0.0)
        return value, -math.log(10) * value


class Cap(Shape):
    """A paraboloid ``1 - r^2``: a sphere's cap of a dent's shallowness, its rim a kink."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        return np.maximum(1 - square, 0), np.where(square < 1, -1.0, 0.0)


class Plate(Shape):
    """``(1 - r^2)^2``, a clamped plate under even load: an oil can, large and soft."""

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        q = np.maximum(1 - square, 0)
        return q * q, -2 * q


@dataclass(frozen=True)
class FlatBottomed(Shape):
    """A flat bottom up to ``r = bottom``, then half a cosine up to the border."""

    bottom: Annotated[float, Limits(0, 0.99)] = 0.5

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        r = np.sqrt(np.minimum(square, 1))
        angle = math.pi * np.maximum(r - self.bottom, 0) / (1 - self.bottom)
        slope = -math.pi / 2 * np.sin(angle) / (1 - self.bottom)
        return (1 + np.cos(angle)) / 2, slope / (2 * np.maximum(r, 1e-9))


@dataclass(frozen=True)
class Crater(Shape):
    """A hole with a raised rim: half a cosine down from the rim's crest, another one outside.

    Attributes
    ----------
    rim : float
        Height of the rim over the skin, as a part of the depth below it.
    crest : float
        Where the rim is highest, as a part of the axes.
    """

    rim: Share = 0.2
    crest: Annotated[float, Limits(0.01, 0.99)] = 0.7

    def profile(self, square: Field) -> tuple[Field, Field]:
        """Part of the depth at ``r^2``, and its derivative with respect to ``r^2``."""
        r = np.sqrt(np.minimum(square, 1))
        inside = r < self.crest
        angle = math.pi * np.where(inside, r / self.crest, (r - self.crest) / (1 - self.crest))
        value = np.where(
            inside,
            (1 - self.rim + (1 + self.rim) * np.cos(angle)) / 2,
            -self.rim * (1 + np.cos(angle)) / 2,
        )
        steepness = np.where(inside, -(1 + self.rim) / self.crest, self.rim / (1 - self.crest))
        slope = steepness * math.pi / 2 * np.sin(angle)
        return value, slope / (2 * np.maximum(r, 1e-9))


@dataclass(frozen=True)
class Valley(Shape):
    """A valley along the length, sharp at its bottom, that runs out at both ends.

    ``(1 - u^4)^2 (1 - t)^2`` with ``t`` a hyperbola in ``v`` that goes from 0 to 1: the flanks
    of a plastic hinge, which die out into the skin. ``bluntness`` is 0 for an edge and 1/2 for
    ``(1 - v^2)^2``.

    Attributes
    ----------
    bluntness : float
        Radius of curvature at the bottom times 8 depth / width^2.
    kind : str
        ``'crease'``, or ``'gouge'`` where material is taken away.
    """

    bluntness: Annotated[float, Limits(above=0, high=0.499)] = 0.1
    kind: str = 'crease'

    border = math.sqrt(2)

    @classmethod
    def of_radius(
        cls, width: float, depth: float, kind: str = 'crease', radius: Positive = 0.002
    ) -> Valley:
        """The valley whose bottom has a radius of curvature, metres."""
        return cls(8 * abs(depth) / width * (radius / width), kind)

    def fraction(self, u: Field, v: Field) -> tuple[Field, Field, Field]:
        """Part of the depth, and its derivatives along `u` and `v`."""
        inside = (np.abs(u) < 1) & (np.abs(v) < 1)
        u, v = np.where(inside, u, 1.0), np.where(inside, v, 1.0)
        # Half width of the hyperbola's bottom: c (sqrt(1 + c^2) - c) = bluntness.
        c = self.bluntness / math.sqrt(1 - 2 * self.bluntness)
        norm = math.sqrt(1 + c * c) - c
        root = np.sqrt(v * v + c * c)
        t = (root - c) / norm
        along, across = (1 - u**4) ** 2, (1 - t) ** 2
        slope_u = -8 * u**3 * (1 - u**4) * across
        slope_v = -2 * (1 - t) * v / (root * norm) * along
        return along * across, slope_u, slope_v


SMOOTH = Smooth()


@dataclass(frozen=True)
class Dent(Checked):
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
    length: Positive
    width: Positive
    depth: float
    angle: float = 0.0
    shape: Shape = SMOOTH
    mark: float = 1.0

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

    @property
    def sharp(self) -> float:
        """Half the side of a square around the centre that holds what is smaller than a pixel."""
        return self.reach

    def covers(self, x: Field, y: Field, margin: float | Field) -> NDArray[np.bool_]:
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
        # From this part of the depth on a mark is whole.
        return 1 + (self.mark - 1) * np.clip(self.shape.fraction(u, v)[0] / 0.3, 0, 1)

    def size(self) -> tuple[float, float]:
        """Length and width of the contour at a tenth of the depth, metres.

        The length is the longest distance across it, the width the longest at 90 degrees to that.
        """
        points = self.outline()
        apart = points[:, None] - points[None]
        square = np.sum(apart * apart, axis=-1)
        first, second = np.unravel_index(np.argmax(square), square.shape)
        length = math.sqrt(square[first, second])
        along_x, along_y = apart[first, second] / length
        return length, float(np.ptp(points @ np.array([-along_y, along_x])))

    def outline(self) -> Field:
        """Contour at a tenth of the depth, from the centre, shape (720, 2), metres."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        u, v = _contour(self.shape) / 2
        along, across = u * self.length, v * self.width
        return np.stack([c * along - s * across, s * along + c * across], axis=-1)

    def _normalised(self, x: Field, y: Field) -> tuple[Field, Field]:
        along, across = turned(x - self.x, y - self.y, self.angle)
        return along / (self.length / 2), across / (self.width / 2)


@dataclass(frozen=True)
class Rivet(Checked):
    """A flush rivet: a round head, slightly proud of the skin, in a shallow groove.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    radius : float
        Of the head, metres.
    groove : float
        Depth of the groove around the head, metres.
    sigma : float
        Half width (standard deviation) of the groove, metres.
    proud : float
        How far the head stands out of the skin, metres.
    dirt : float
        Part of the paint's reflectance that is lost at the groove's bottom, 0 to 1.
    """

    x: float
    y: float
    radius: Positive = 0.004
    groove: float = 80e-6
    sigma: Positive = 250e-6
    proud: float = 30e-6
    dirt: Share = 0.35

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds the rivet, metres."""
        # At 1.6 radii a rivet's groove and step have died out to 1e-8 of their height.
        return 1.6 * self.radius

    @property
    def rise(self) -> float:
        """Largest height above or below the skin, metres."""
        return abs(self.groove) + abs(self.proud)

    @property
    def sharp(self) -> float:
        """Half the side of a square around the centre that holds what is smaller than a pixel."""
        # A groove has died out at this many of its half widths.
        return self.radius + 4.0 * self.sigma

    def covers(self, x: Field, y: Field, margin: float | Field) -> NDArray[np.bool_]:
        """Mask of panel coordinates where it, widened by `margin` metres, is not zero."""
        return within(self, self.reach + margin, x, y)

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        dx, dy = x - self.x, y - self.y
        distance = np.hypot(dx, dy) + 1e-12  # The centre has no direction, and no slope.
        beyond = (distance - self.radius) / self.sigma
        groove = self.groove * np.exp(-0.5 * beyond * beyond)
        head = 1 / (1 + np.exp(np.minimum(2 * beyond, 500.0)))
        slope = (2 * self.proud * head * (1 - head) - groove * beyond) / self.sigma
        return groove - self.proud * head, slope * dx / distance, slope * dy / distance

    def clean(self, x: Field, y: Field) -> Field:
        """Part of the reflectance that the groove's dirt leaves, at panel coordinates."""
        beyond = (np.hypot(x - self.x, y - self.y) - self.radius) / self.sigma
        return 1 - self.dirt * np.exp(-0.5 * beyond * beyond)


Feature = Dent | Rivet


def within(feature: Feature, radius: float | Field, x: Field, y: Field) -> NDArray[np.bool_]:
    """Mask of panel coordinates nearer than so much to the middle of a dent or rivet, metres."""
    return (x - feature.x) ** 2 + (y - feature.y) ** 2 < radius * radius


def domed_rivet(x: float, y: float, radius: Positive = 0.004, proud: Positive = 0.0012) -> Dent:
    """A rivet whose head is a sphere's cap on the skin (universal or brazier head), metres."""
    return Dent(x, y, 2 * radius, 2 * radius, -proud, shape=Cap())


@lru_cache(maxsize=256)
def _contour(shape: Shape) -> Field:
    """Outermost normalised points (u, v) at a tenth of the depth, shape (2, directions)."""
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    direction = np.stack([np.cos(angles), np.sin(angles)])
    radii = np.linspace(0, shape.border, _ALONG_A_RAY)
    u, v = radii[:, None] * direction[:, None]
    above = shape.fraction(u, v)[0] > _LEVEL
    last = _ALONG_A_RAY - 1 - np.argmax(above[::-1], axis=0)
    low, high = radii[last], radii[np.minimum(last + 1, _ALONG_A_RAY - 1)]
    for _ in range(32):
        middle = (low + high) / 2
        inside = shape.fraction(*(middle * direction))[0] > _LEVEL
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return direction * low
