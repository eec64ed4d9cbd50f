"""The shape of a dent (eq. 18) and of a flush rivet, as height fields over a panel.

Heights are along the panel's z axis, which points into the aircraft: a dent is positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError

# exp(1 - 1/q) is below 1e-300 here, and its slope does not overflow.
_RIM = 1.4e-3
# At 1.6 radii a rivet's groove and step have died out to 1e-8 of their height.
_RIVET_REACH = 1.6

Field = NDArray[np.float64]


@dataclass(frozen=True)
class Dent:
    """The dent function, eq. 18, scaled, rotated and moved.

    ``depth * exp(1 - 1 / (1 - r^2))`` inside the ellipse r < 1: smooth, with a vanishing border.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    length, width : float
        Full axes of the ellipse outside which the dent is zero, metres.
    depth : float
        Deepest point, metres; positive is pushed in, negative a bulge.
    angle : float
        From the panel's x axis to the dent's length, towards y, radians.
    """

    x: float
    y: float
    length: float
    width: float
    depth: float
    angle: float = 0.0

    def __post_init__(self) -> None:
        _require_positive(self, 'length', 'width')

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds the dent, metres."""
        return max(self.length, self.width) / 2

    @property
    def rise(self) -> float:
        """Largest height above or below the skin, metres."""
        return abs(self.depth)

    def covers(self, x: Field, y: Field, margin: float | Field = 0.0) -> NDArray[np.bool_]:
        """Mask of panel coordinates where the dent, widened by `margin` metres, is not zero."""
        u, v = self._normalised(x, y)
        shortest = min(self.length, self.width) / 2
        return u * u + v * v < (1 + margin / shortest) ** 2

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        u, v = self._normalised(x, y)
        q = np.maximum(1 - u * u - v * v, _RIM)
        height = np.where(q > _RIM, self.depth * np.exp(1 - 1 / q), 0.0)
        slope = -2 * height / (q * q)
        c, s = math.cos(self.angle), math.sin(self.angle)
        a, b = self.length / 2, self.width / 2
        return height, slope * (u * c / a - v * s / b), slope * (u * s / a + v * c / b)

    def size_at(self, level: float = 0.1) -> tuple[float, float]:
        """Length and width of the contour at a fraction `level` of the depth, metres."""
        scale = math.sqrt(1 - 1 / (1 - math.log(level)))
        return scale * self.length, scale * self.width

    def _normalised(self, x: Field, y: Field) -> tuple[Field, Field]:
        c, s = math.cos(self.angle), math.sin(self.angle)
        dx, dy = x - self.x, y - self.y
        return (c * dx + s * dy) / (self.length / 2), (c * dy - s * dx) / (self.width / 2)


@dataclass(frozen=True)
class Rivet:
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
    radius: float = 0.004
    groove: float = 80e-6
    sigma: float = 250e-6
    proud: float = 30e-6
    dirt: float = 0.35

    def __post_init__(self) -> None:
        _require_positive(self, 'radius', 'sigma')

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds the rivet, metres."""
        return _RIVET_REACH * self.radius

    @property
    def rise(self) -> float:
        """Largest height above or below the skin, metres."""
        return abs(self.groove) + abs(self.proud)

    def covers(self, x: Field, y: Field, margin: float | Field = 0.0) -> NDArray[np.bool_]:
        """Mask of panel coordinates where the rivet, widened by `margin` metres, is not zero."""
        reach = self.reach + margin
        return (x - self.x) ** 2 + (y - self.y) ** 2 < reach * reach

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


def _require_positive(shape: Dent | Rivet, *names: str) -> None:
    for name in names:
        if not getattr(shape, name) > 0:
            kind = type(shape).__name__.lower()
            raise ConfigurationError(
                f'the {name} of a {kind} is {getattr(shape, name)!r}: give a positive length'
            )
