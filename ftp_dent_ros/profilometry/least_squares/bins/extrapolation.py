"""Fields at the nodes, continued beyond the region that they are known in."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import (
    Windows,
    blurred,
    coarsened,
    interpolated,
)

# Width of the neighbourhood that speaks for what lies beyond, windows.
_WIDTH = 4.0
# Share of it that must be known.
_LEAST = 0.01
# Of a coarse node, that must be known for a slope.
_WHOLE = 0.9
# Standard deviation that is left on the coarse grid.
_SIGMA = 1.5


class Extrapolation:
    """Continues fields that are known at the same nodes.

    Parameters
    ----------
    known : ndarray, shape (rows, columns), bool
    windows : Windows
    """

    def __init__(self, known: NDArray[np.bool_], windows: Windows) -> None:
        self._known, self._all = known, bool(known.all())
        if self._all:
            return
        self._shape = known.shape
        self._share = known.astype(np.float32)
        sigmas = _WIDTH * windows.sigma_u, _WIDTH * windows.sigma_v
        self._steps = [max(1, int(sigma / _SIGMA)) for sigma in sigmas]
        self._sigmas = [sigma / step for sigma, step in zip(sigmas, self._steps, strict=True)]
        self._weight = self._coarse(self._share)
        self._total = self._blur(self._weight)
        self._scale = 1 / at_least(self._total, _LEAST)

    def by_mean(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Continue a field by the weighted mean of what is known around, to zero far away."""
        if self._all:
            return field
        fine = self._fine(self._mean(self._coarse(field * self._share)))
        return self._with_known(fine, field)

    def by_slope(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Continue a field by mean and slope of what is known around, to zero far away.

        The mean belongs to the centre of gravity of the known neighbours; the slope carries it
        from there to the node.

        Parameters
        ----------
        field : ndarray, shape (rows, columns), float32
            Finite everywhere.

        Returns
        -------
        ndarray, shape (rows, columns), float32
        """
        if self._all:
            return field
        values = self._coarse(field * self._share)
        mean = self._mean(values)
        values = values / at_least(self._weight, _WHOLE)
        result = None
        for axis in (0, 1):
            slope = self._slope(values, axis)
            mean -= slope * self._centres[axis]
            carried = self._fine(slope)
            carried *= self._positions[axis]
            result = carried if result is None else np.add(result, carried, out=result)
        result += self._fine(mean)
        result *= self._near
        return self._with_known(result, field)

    def _coarse(self, field):
        return coarsened(field, self._steps)

    def _blur(self, field):
        return blurred(field, self._sigmas, cv2.BORDER_CONSTANT)

    def _mean(self, weighted):
        return self._blur(weighted) * self._scale

    def _slope(self, values, axis):
        """Mean of the central differences between known neighbours."""
        inner, pairs, scale = self._pairs[axis]
        ahead, behind, _ = _neighbours(axis)
        slope = np.zeros_like(values)
        np.subtract(values[ahead], values[behind], out=slope[inner])
        slope[inner] *= pairs
        return self._blur(slope) * scale

    @cached_property
    def _pairs(self):
        """Of each axis, where differences are, their pitch if they are known, and their scale."""
        whole = self._weight > _WHOLE
        found = []
        for axis in (0, 1):
            ahead, behind, inner = _neighbours(axis)
            seen = np.zeros_like(self._weight)
            seen[inner] = whole[ahead] & whole[behind]
            pitch = np.float32(0.5 * self._weight.shape[axis] / self._shape[axis])
            found.append((inner, pitch * seen[inner], 1 / at_least(self._blur(seen), _LEAST)))
        return found

    @cached_property
    def _positions(self):
        """Rows and columns of the nodes."""
        rows, columns = self._shape
        return [each.astype(np.float32) for each in np.ogrid[:rows, :columns]]

    @cached_property
    def _centres(self):
        """Row and column of the centre of gravity of what is known around."""
        return [self._mean(self._coarse(each * self._share)) for each in self._positions]

    @cached_property
    def _near(self):
        """1 at nodes of which any neighbour is known, else 0."""
        near: Any = (self._total >= _LEAST).astype(np.float32)
        if near.shape == self._shape:
            return near
        return cv2.resize(near, self._shape[::-1], interpolation=cv2.INTER_NEAREST)

    def _with_known(self, continued, field):
        """The field where it is known; masked copies of OpenCV's are far faster than NumPy's."""
        return cv2.copyTo(field, self._known.view(np.uint8), continued)

    def _fine(self, coarse):
        return interpolated(coarse, self._shape)


def _neighbours(axis: int) -> tuple[tuple[slice, ...], ...]:
    """Ahead, behind and in between along an axis."""
    ahead, behind, inner = (
        tuple(part if one == axis else slice(None) for one in (0, 1))
        for part in (slice(2, None), slice(None, -2), slice(1, -1))
    )
    return ahead, behind, inner
