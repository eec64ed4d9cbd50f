"""Gaussian blurs over a metric grid."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

Field = NDArray[np.float64]


class Grid:
    """Positions on a square grid, and Gaussian blurs over it.

    Parameters
    ----------
    x, y : ndarray, shape (columns,) and (rows,)
        Metres.
    """

    def __init__(self, x: Field, y: Field) -> None:
        self.x, self.y = np.meshgrid(x, y)
        self._shape = tuple(scipy.fft.next_fast_len(n, real=True) for n in self.x.shape)
        self.step = float(x[1] - x[0])
        down = 2 * np.pi * scipy.fft.fftfreq(self._shape[0], self.step)
        across = 2 * np.pi * scipy.fft.rfftfreq(self._shape[1], self.step)
        self._square = down[:, None] ** 2 + across**2

    def blurred(self, values: Field, variance: float) -> Field:
        """Values, shape (..., rows, columns), after a Gaussian of `variance`, square metres."""
        return self._back(self._forth(values) * np.exp(-variance / 2 * self._square))

    def blurred_and_slope(self, values: Field, variance: float) -> tuple[Field, Field]:
        """The same, and its derivative with the variance."""
        spectrum = self._forth(values) * np.exp(-variance / 2 * self._square)
        return self._back(spectrum), self._back(-self._square / 2 * spectrum)

    def _forth(self, values: Field) -> Field:
        return scipy.fft.rfft2(values, self._shape)

    def _back(self, spectrum: Field) -> Field:
        rows, columns = self.x.shape
        return scipy.fft.irfft2(spectrum, self._shape)[..., :rows, :columns]
