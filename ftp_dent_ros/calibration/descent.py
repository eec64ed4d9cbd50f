"""Least squares by Levenberg and Marquardt's method, many small problems at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

# Damping, of the normal equations' diagonal: first, least and most, and its factor a step.
_FIRST, _LEAST, _MOST, _FACTOR = 1e-2, 1e-10, 1e9, 10.0

#: Cost (n,), half of its gradient (n, k) and the normal matrix (n, k, k) of states (n, k).
Linearised = Callable[[NDArray], tuple[NDArray, NDArray, NDArray]]


def descend(
    linearised: Linearised, state: NDArray[np.float64], tolerance: float, steps: int
) -> NDArray[np.float64]:
    """States of shape (n, k) at the least cost.

    Parameters
    ----------
    linearised : callable
    state : ndarray, shape (n, k)
        To start from.
    tolerance : float
        Relative change of the cost at which all have arrived.
    steps : int
        At most.
    """
    state, damping = state.copy(), np.full(len(state), _FIRST)
    cost, gradient, normal = linearised(state)
    for _ in range(steps):
        scale = np.sqrt(np.maximum(np.einsum('nii->ni', normal), 1e-300))
        damped = normal / (scale[:, :, None] * scale[:, None])
        damped = damped + damping[:, None, None] * np.eye(state.shape[1])
        tried = state - np.linalg.solve(damped, (gradient / scale)[..., None])[..., 0] / scale
        found = linearised(tried)
        better = found[0] < cost
        arrived = np.abs(found[0] - cost) <= tolerance * cost
        for kept, new in zip((state, cost, gradient, normal), (tried, *found), strict=True):
            kept[better] = new[better]
        damping = np.clip(np.where(better, damping / _FACTOR, damping * _FACTOR), _LEAST, _MOST)
        if arrived.all():
            break
    return state
