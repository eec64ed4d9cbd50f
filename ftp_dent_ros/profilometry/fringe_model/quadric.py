"""A robust quadric of inverse depth: exact for planes, near enough for a fuselage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.robust import fitted

# Points that a fit is through, about: six unknowns need no more.
_POINTS = 1500


@dataclass(frozen=True, eq=False)
class Quadric:
    """Inverse depth c_0 + c_1 x + c_2 y + c_3 x^2 + c_4 x y + c_5 y^2 at places of the picture."""

    coefficients: NDArray[np.float64]

    @classmethod
    def through(
        cls,
        x: NDArray[np.floating],
        y: NDArray[np.floating],
        inverse_depth: NDArray[np.floating],
    ) -> Quadric:
        """Robust quadric through points, arrays of shape (points,): dents are outliers."""
        x, y, values = (each[:: max(1, len(x) // _POINTS)] for each in (x, y, inverse_depth))
        return cls(fitted(_terms(x, y), values))

    def at(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float32]:
        """Inverse depth at places, x and y that broadcast."""
        c, x, y = (each.astype(np.float32) for each in (self.coefficients, x, y))
        return x * (c[3] * x + c[1] + c[4] * y) + (y * (c[5] * y + c[2]) + c[0])


def _terms(x, y):
    x, y = np.broadcast_arrays(x, y)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def quadric_through(places, values: NDArray[np.floating], mask: NDArray[np.bool_]) -> Quadric:
    """Quadric through the values of a mask at places, x and y that broadcast to its shape."""
    x, y = (each[mask] for each in np.broadcast_arrays(*places))
    return Quadric.through(x, y, values[mask])
