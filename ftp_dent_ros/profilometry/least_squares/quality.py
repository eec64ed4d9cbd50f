"""How good each point of a least-squares measurement is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.refinement import Refined
from ftp_dent_ros.profilometry.least_squares.sight import Sight

# Radians over which the depth's change with the phase is taken.
_STEP = 0.05
# Share of the lit area that may be left out without a remark.
_LEFT_OUT = 0.02


@dataclass(frozen=True, eq=False)
class Fit:
    """What one surface was fitted with.

    Attributes
    ----------
    nodes : Sight
    phase : ndarray, shape (rows, columns), float32
        Absolute phase at the nodes, radians.
    refined : Refined
    measured : ndarray, shape (rows, bins), bool
        Bins that were published.
    """

    nodes: Sight
    phase: NDArray[np.float32]
    refined: Refined
    measured: NDArray[np.bool_]

    def deviation(self) -> NDArray[np.float32]:
        """Predicted standard deviation of the depth at the nodes, metres."""
        here, _ = self.nodes.meet(self.phase)
        there, _ = self.nodes.meet(self.phase + np.float32(_STEP))
        slope = np.abs(1 / there - 1 / here) / np.float32(_STEP)
        return slope * np.sqrt(self.refined.shift.variance)


@dataclass(frozen=True, eq=False)
class Quality:
    """Figures of merit of each point, computed when they are asked for.

    Attributes
    ----------
    untied : float
        Share of the lit area, but for its rim, without points: for want of a tie to the stripe.
    fits : tuple of Fit
        Of the measurement's surfaces.
    grid : Grid
    stride : int
        Of the cloud.
    """

    untied: float
    fits: tuple[Fit, ...]
    grid: Grid
    stride: int

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the measurement left out, and why: a sentence each."""
        if self.untied <= _LEFT_OUT:
            return ()
        return (
            f'{self.untied:.0%} of the lit area is not tied to the red stripe (a step or a gap '
            'lies between): bring the stripe onto it to measure it',
        )

    def standard_deviation(self) -> NDArray[np.float32]:
        """Predicted standard deviation of each point's depth, metres, as the cloud's grid.

        NaN where there is no point; under noise as in the photograph, speckle too.
        """
        return self._at_points(lambda fit: fit.deviation())

    def residual(self) -> NDArray[np.float32]:
        """Root mean square of what the fringes do not explain around each point, in amplitudes."""
        return self._at_points(lambda fit: fit.refined.roughness)

    def _at_points(self, values: Callable[[Fit], NDArray]) -> NDArray[np.float32]:
        rows, columns = self.grid.bin_shape
        size = columns * self.grid.step, rows * self.grid.pitch[1]
        result = np.full(size[::-1], np.nan, np.float32)
        around = np.ones((3, 3), np.uint8)  # a rim's rows of pixels
        for fit in self.fits:
            measured = cv2.dilate(fit.measured.view(np.uint8), around)
            inside = cv2.resize(measured, size, interpolation=cv2.INTER_NEAREST) > 0
            dense = cv2.resize(values(fit), size, interpolation=cv2.INTER_LINEAR)
            np.copyto(result, dense, where=inside)
        step = self.stride
        return result[: self.grid.height : step, : self.grid.width : step]
