"""Fields at the nodes, continued beyond the region that they are known in."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.windows import Windows, blurred

# Width of the neighbourhood that speaks for what lies beyond, windows.
_WIDTH = 4.0
# Share of it that must be known.
_LEAST = 0.01
# Of a coarse node, that must be known for a slope.
_WHOLE = 0.9
# Standard deviation that is left on the coarse grid.
_SIGMA = 1.5


def continued(
    field: NDArray[np.float32], known: NDArray[np.bool_], windows: Windows
) -> NDArray[np.float32]:
    """Continue a positive field by the weighted mean of what is known around."""
    if known.all():
        return field
    coarse = _Coarse.of(field, known, windows)
    return np.where(known, field, coarse.fine(coarse.mean(coarse.values)))


def continued_by_slope(
    field: NDArray[np.float32], known: NDArray[np.bool_], windows: Windows
) -> NDArray[np.float32]:
    """Continue a field by mean and slope of what is known around, to zero far away.

    The mean belongs to the centre of gravity of the known neighbours; the slope carries it from
    there to the node.

    Parameters
    ----------
    field : ndarray, shape (rows, columns), float32
        Finite everywhere.
    known : ndarray, shape (rows, columns), bool
    windows : Windows

    Returns
    -------
    ndarray, shape (rows, columns), float32
    """
    if known.all():
        return field
    coarse = _Coarse.of(field, known, windows)
    result = coarse.mean(coarse.values)
    rows, columns = coarse.values.shape
    for axis, positions in enumerate(np.ogrid[:rows, :columns]):
        position = np.broadcast_to(positions.astype(np.float32), (rows, columns))
        result += coarse.slope(axis) * (position - coarse.mean(position * coarse.weight))
    result[coarse.total < _LEAST] = 0
    return np.where(known, field, coarse.fine(result))


@dataclass(frozen=True, eq=False)
class _Coarse:
    """A field on a grid as coarse as the neighbourhoods allow: times weight, weight, and total."""

    values: NDArray[np.float32]
    weight: NDArray[np.float32]
    total: NDArray[np.float32]
    sigmas: tuple[float, float]
    shape: tuple[int, int]

    @classmethod
    def of(cls, field, known, windows: Windows) -> _Coarse:
        weight = known.astype(np.float32)
        sigmas = _WIDTH * windows.sigma_u, _WIDTH * windows.sigma_v
        steps = [max(1, int(sigma / _SIGMA)) for sigma in sigmas]
        size = [-(-length // step) for length, step in zip(field.shape[::-1], steps, strict=True)]
        values = cv2.resize(field * weight, size, interpolation=cv2.INTER_AREA)
        weight = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
        left = sigmas[0] / steps[0], sigmas[1] / steps[1]
        total = blurred(weight, left, cv2.BORDER_CONSTANT)
        return cls(values, weight, total, left, field.shape)

    def blur(self, field):
        return blurred(field, self.sigmas, cv2.BORDER_CONSTANT)

    def mean(self, weighted):
        return self.blur(weighted) / np.maximum(self.total, _LEAST)

    def slope(self, axis):
        """Mean of the central differences between known neighbours."""
        ahead, behind, inner = (
            tuple(part if one == axis else slice(None) for one in (0, 1))
            for part in (slice(2, None), slice(None, -2), slice(1, -1))
        )
        whole = self.weight > _WHOLE
        values = self.values / np.maximum(self.weight, _WHOLE)
        pairs = (whole[ahead] & whole[behind]).astype(np.float32)
        slope, seen = np.zeros_like(values), np.zeros_like(values)
        slope[inner] = 0.5 * (values[ahead] - values[behind]) * pairs
        seen[inner] = pairs
        return self.blur(slope) / np.maximum(self.blur(seen), _LEAST)

    def fine(self, field):
        return cv2.resize(field, self.shape[::-1], interpolation=cv2.INTER_LINEAR)
