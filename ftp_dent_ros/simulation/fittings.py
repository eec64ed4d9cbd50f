"""What anything fixed to a skin has in common.

Heights are along the panel's z axis, which points into the aircraft: what stands out is negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.fields import Checked, Positive, Share

Field = NDArray[np.float64]


@dataclass(frozen=True)
class Fitting(Checked):
    """A round height field with a place and an end, that changes within a pixel.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    radius : float
        Metres.
    """

    x: float
    y: float
    radius: Positive = 0.004

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds it, metres."""
        return self.radius

    @property
    def rise(self) -> float:
        """Largest height above or below the skin, metres."""
        raise NotImplementedError

    def covers(self, x: Field, y: Field, margin: float | Field = 0.0) -> NDArray[np.bool_]:
        """Mask of panel coordinates where it, widened by `margin` metres, is not zero."""
        return self._within(self.reach + margin, x, y)

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        raise NotImplementedError

    def sharp(self, x: Field, y: Field, margin: float) -> NDArray[np.bool_]:
        """Mask of panel coordinates within `margin` metres of what changes within a pixel."""
        return self.covers(x, y, margin)

    def clean(self, x: Field, y: Field) -> Field:
        """Factor on the paint's albedo at panel coordinates: 1, painted as the skin is."""
        return np.ones_like(x)

    def _within(self, radius: float | Field, x: Field, y: Field) -> NDArray[np.bool_]:
        return (x - self.x) ** 2 + (y - self.y) ** 2 < radius * radius


@dataclass(frozen=True)
class Rivet(Fitting):
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

    def sharp(self, x: Field, y: Field, margin: float) -> NDArray[np.bool_]:
        """Mask of panel coordinates within `margin` metres of head and groove."""
        # A groove has died out at this many of its half widths.
        return self._within(self.radius + 4.0 * self.sigma + margin, x, y)

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


@dataclass(frozen=True)
class DomedRivet(Fitting):
    """A rivet whose head is a sphere's cap on the skin (universal or brazier head).

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    radius : float
        Of the head, metres.
    proud : float
        How far its middle stands out of the skin, metres.
    """

    proud: Positive = 0.0012

    @property
    def rise(self) -> float:
        """Largest height above the skin, metres."""
        return self.proud

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        u, v = (x - self.x) / self.radius, (y - self.y) / self.radius
        part = 1 - u * u - v * v
        slope = np.where(part > 0, 2 * self.proud / self.radius, 0.0)
        return -self.proud * np.maximum(part, 0), slope * u, slope * v
