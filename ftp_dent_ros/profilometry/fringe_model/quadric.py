"""A robust quadric of inverse depth: exact for planes, near enough for a fuselage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Fits, each with the weights of what the last one left (Geman and McClure's function).
_FITS = 5


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
        terms, values = _terms(x, y), inverse_depth.astype(float)
        weight = np.ones(len(values))
        for _ in range(_FITS):
            weighted = terms * weight
            c = np.linalg.lstsq(weighted @ terms.T, weighted @ values, rcond=None)[0]
            left = values - c @ terms
            scale = 1.48 * np.median(np.abs(left)) + 1e-9
            weight = 1 / np.square(1 + np.square(left / (4 * scale)))
        return cls(c)

    def at(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float32]:
        """Inverse depth at places."""
        return np.tensordot(self.coefficients, _terms(x, y), axes=1).astype(np.float32)


def _terms(x, y):
    x, y = np.broadcast_arrays(x, y)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
