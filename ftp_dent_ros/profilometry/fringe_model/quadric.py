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

    def at(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float32]:
        """Inverse depth at places, x and y that broadcast."""
        c, x, y = (each.astype(np.float32) for each in (self.coefficients, x, y))
        return x * (c[3] * x + c[1] + c[4] * y) + (y * (c[5] * y + c[2]) + c[0])


def quadric_through(places, values: NDArray[np.floating], mask: NDArray[np.bool_]) -> Quadric:
    """Robust quadric through the values of a mask at places: dents are outliers.

    Parameters
    ----------
    places : tuple of ndarray
        x and y that broadcast to the shape of the values.
    """
    inside = np.flatnonzero(mask)
    some = inside[:: max(1, len(inside) // _POINTS)]
    x, y = (
        np.broadcast_to(each, mask.shape)[np.unravel_index(some, mask.shape)] for each in places
    )
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    return Quadric(fitted(terms, values.ravel()[some]))
