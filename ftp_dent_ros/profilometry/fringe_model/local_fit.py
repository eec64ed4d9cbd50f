"""Weighted least squares of light in windows: level, amplitude, and shift of the fringes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid

#: Fringes from a window to those at its sides: an edge there is three deviations off.
ASIDE = 3 * WIDTH
# Of single precision, which sums of light have: less is nothing to divide by.
_EPSILON = np.finfo(np.float32).eps


@dataclass(frozen=True, eq=False)
class LocalFit:
    """I = level + amplitude F + slope F' in the window about each node (eq. 3).

    Attributes
    ----------
    level, amplitude, slope : ndarray, shape (rows, nodes), float32
    squares : callable
        Computes `rest` and `total`, which not all need.
    """

    level: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    slope: NDArray[np.float32]
    squares: Callable[[], tuple[NDArray[np.float32], NDArray[np.float32]]]

    @classmethod
    def of_mixture(cls, fits: Sequence[LocalFit], shares: Sequence[float]) -> LocalFit:
        """Fit of lights by their shares, of which the same is not explained."""

        def mixed(values):
            return sum(
                np.float32(share) * each for share, each in zip(shares, values, strict=True)
            )

        level, amplitude, slope = (
            mixed([getattr(fit, name) for fit in fits]) for name in ('level', 'amplitude', 'slope')
        )

        def squares():
            rest, total = (
                np.square(mixed([np.sqrt(getattr(fit, name)) for fit in fits]))
                for name in ('rest', 'total')
            )
            return rest, total

        return cls(level, amplitude, slope, squares)

    @cached_property
    def _squares(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return self.squares()

    @property
    def rest(self) -> NDArray[np.float32]:
        """Weighted mean square of what the fit leaves."""
        return self._squares[0]

    @property
    def total(self) -> NDArray[np.float32]:
        """Weighted mean square of the light about its mean."""
        return self._squares[1]

    @property
    def swing(self) -> Any:
        """Amplitude of the fringes, whatever their shift."""
        # OpenCV's magnitude depends on where in memory the arrays are.
        return np.sqrt(np.square(self.slope) + np.square(self.amplitude))

    @property
    def shift(self) -> NDArray[Any]:
        """Of the fringes, from their waveform's phase to their own, radians."""
        return np.arctan2(self.slope, self.amplitude)


class Windows:
    """Normal equations of a waveform and its derivative in the windows about the nodes.

    Parameters
    ----------
    grid : BinGrid
    waveform, derivative, weight : ndarray, shape (rows, columns), float32
        F, F' and the weight of the bins.

    Attributes
    ----------
    weight : ndarray, shape (rows, nodes), float32
        Mean weight of the window's bins; small where little light is usable.
    """

    def __init__(
        self,
        grid: BinGrid,
        waveform: NDArray[np.float32],
        derivative: NDArray[np.float32],
        weight: NDArray[np.float32],
    ) -> None:
        self._grid, self._bins = grid, (weight, weight * waveform, weight * derivative)
        _, by_waveform, by_slope = self._bins
        self.weight, self._f, self._d, ff, fd, dd = (
            grid.window_sums(each)
            for each in (
                *self._bins,
                *(by_waveform * waveform, by_waveform * derivative, by_slope * derivative),
            )
        )
        self._mean = 1 / np.maximum(self.weight, _EPSILON)
        ff -= self._f * self._f * self._mean
        fd -= self._f * self._d * self._mean
        dd -= self._d * self._d * self._mean
        scale = 1 / np.maximum(ff * dd - fd * fd, _EPSILON)
        self._inverse = dd * scale, fd * scale, ff * scale

    def variances(
        self, level: NDArray[np.float32], amplitude: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], tuple[NDArray[np.float32], ...]]:
        """Variance of the slope over that of noise in a window.

        Parameters
        ----------
        level, amplitude : ndarray, shape (rows, nodes), float32

        Returns
        -------
        variance : ndarray, shape (rows, nodes), float32
        ratios : tuple of ndarray
            The variance over those of the logarithms of contrast and amplitude.
        """
        dd, fd, ff = self._inverse
        of_amplitude = dd / np.square(amplitude)
        with_level = (self._d * fd - self._f * dd) * self._mean / (level * amplitude)
        of_both = self._f * self._f * dd - 2 * self._f * self._d * fd + self._d * self._d * ff
        of_level = (self._mean + of_both * self._mean * self._mean) / np.square(level)
        of_contrast = of_amplitude - 2 * with_level + of_level
        least = np.finfo(np.float32).tiny
        return ff, tuple(ff / np.maximum(each, least) for each in (of_contrast, of_amplitude))

    def fit(self, light: NDArray[Any]) -> LocalFit:
        """Fit bins of light, shape (rows, columns)."""
        weight, by_waveform, by_slope = self._bins
        i, fi, di = (
            self._grid.window_sums(each)
            for each in (weight * light, by_waveform * light, by_slope * light)
        )
        fi -= self._f * i * self._mean
        di -= self._d * i * self._mean
        dd, fd, ff = self._inverse
        amplitude, slope = fi * dd - di * fd, di * ff - fi * fd
        level = (i - amplitude * self._f - slope * self._d) * self._mean

        def squares():
            ii = self._grid.window_sums(weight * light * light) - i * i * self._mean
            rest = np.maximum(ii - amplitude * fi - slope * di, 0) * self._mean
            return rest, np.maximum(ii, 0) * self._mean

        return LocalFit(level, amplitude, slope, squares)
