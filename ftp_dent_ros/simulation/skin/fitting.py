"""What anything fixed to a skin has in common.

Heights are along the panel's z axis, which points into the aircraft: what stands out is negative.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float64]


@dataclass(frozen=True)
class Fitting(ABC):
    """A height field with a place and an end, as dents are, that changes within a pixel.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    """

    x: float
    y: float

    @property
    @abstractmethod
    def reach(self) -> float:
        """Half the side of a square around the centre that holds it, metres."""

    @property
    @abstractmethod
    def rise(self) -> float:
        """Largest height above or below the skin, metres."""

    @abstractmethod
    def covers(self, x: Field, y: Field, margin: float | Field = 0.0) -> NDArray[np.bool_]:
        """Mask of panel coordinates where it, widened by `margin` metres, is not zero."""

    @abstractmethod
    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""

    def sharp(self, x: Field, y: Field, margin: float) -> NDArray[np.bool_]:
        """Mask of panel coordinates within `margin` metres of what changes within a pixel."""
        return self.covers(x, y, margin)

    def clean(self, x: Field, y: Field) -> Field:
        """Factor on the paint's albedo at panel coordinates: 1, painted as the skin is."""
        return np.ones_like(x)


@dataclass(frozen=True)
class RoundFitting(Fitting):
    """A fitting that looks the same from all around.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    radius : float
        Metres.
    """

    radius: float = 0.004

    @property
    def reach(self) -> float:
        """Half the side of a square around the centre that holds it, metres."""
        return self.radius

    def covers(self, x: Field, y: Field, margin: float | Field = 0.0) -> NDArray[np.bool_]:
        """Mask of panel coordinates where it, widened by `margin` metres, is not zero."""
        return self._within(self.reach + margin, x, y)

    def _within(self, radius: float | Field, x: Field, y: Field) -> NDArray[np.bool_]:
        return (x - self.x) ** 2 + (y - self.y) ** 2 < radius * radius
