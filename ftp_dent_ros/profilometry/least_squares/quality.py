"""How good each point of a least-squares measurement is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Quality:
    """Figures of merit, kept on the coarse grid and interpolated when they are asked for.

    Attributes
    ----------
    untied : float
        Share of the lit area that could not be tied to the stripe and has no points.
    remarks : tuple of str
        What the measurement left out, and why.
    """

    untied: float
    remarks: tuple[str, ...]
    _deviation: NDArray[np.float32]
    _misfit: NDArray[np.float32]
    _size: tuple[int, int]
    _stride: int

    def standard_deviation(self) -> NDArray[np.float32]:
        """Predicted standard deviation of each point's depth, metres, shape (rows, columns)."""
        return self._at_points(self._deviation)

    def residual(self) -> NDArray[np.float32]:
        """Root mean square around each point of what the fringes do not explain, in amplitudes."""
        return self._at_points(self._misfit)

    def _at_points(self, coarse):
        height, width = self._size
        return cv2.resize(coarse, (width, height))[:: self._stride, :: self._stride]
