"""Fields at the nodes, continued beyond the region that they are known in."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.windows import Windows

# Width of the neighbourhood that speaks for what lies beyond, windows.
_WIDTH = 4.0
# Share of it that must be known.
_LEAST = 0.01


def continued(
    fields: list[NDArray[np.float32]], known: NDArray[np.bool_], windows: Windows
) -> list[NDArray[np.float32]]:
    """Continue positive fields by the weighted mean of what is known around."""
    if known.all():
        return fields
    weight = known.astype(np.float32)
    total = np.maximum(_blur(weight, windows), _LEAST)
    means = [_blur(field * weight, windows) / total for field in fields]
    return [np.where(known, *both) for both in zip(fields, means, strict=True)]


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
    weight = known.astype(np.float32)
    values = field * weight
    total = _blur(weight, windows)
    scale = 1 / np.maximum(total, _LEAST)
    result = _blur(values, windows) * scale
    for axis, positions in enumerate(np.ogrid[: field.shape[0], : field.shape[1]]):
        position = np.broadcast_to(positions.astype(np.float32), field.shape)
        slope, pairs = _slope(values, weight, axis)
        slope = _blur(slope, windows) / np.maximum(_blur(pairs, windows), _LEAST)
        result += slope * (position - _blur(position * weight, windows) * scale)
    result[total < _LEAST] = 0
    return np.where(known, field, result)


def _slope(values, weight, axis):
    """Central differences where both neighbours are known, and where that is."""
    ahead, behind, inner = (
        tuple(part if one == axis else slice(None) for one in (0, 1))
        for part in (slice(2, None), slice(None, -2), slice(1, -1))
    )
    slope, pairs = np.zeros_like(values), np.zeros_like(values)
    pairs[inner] = weight[ahead] * weight[behind]
    slope[inner] = 0.5 * (values[ahead] - values[behind]) * pairs[inner]
    return slope, pairs


def _blur(field, windows: Windows) -> NDArray[np.float32]:
    return windows.wide(field, _WIDTH, cv2.BORDER_CONSTANT)
