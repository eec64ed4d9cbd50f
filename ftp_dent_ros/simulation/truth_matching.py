"""Which of the places that were found are which of those that are there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from ftp_dent_ros.simulation.truth import TrueDent

# What a pair costs that cannot be: more than all that can, each of which costs 1 at most.
_NEVER = 1e6


def match_truth(
    found: ArrayLike,
    true: ArrayLike,
    reach: ArrayLike,
    may_be: NDArray[np.bool_] | None = None,
) -> dict[int, int]:
    """Pairs of true and found places, as many as can be, and of these the nearest by their reach.

    Parameters
    ----------
    found : array_like, shape (n, 3)
        Metres.
    true : array_like, shape (m, 3)
        In the same frame.
    reach : array_like, broadcast to shape (n, m)
        How far a found place may lie off a true one, metres.
    may_be : ndarray, shape (n, m), bool, optional
        What else a pair has to be.

    Returns
    -------
    dict
        Index of the one found, by that of the true one: each at most once.
    """
    places = [np.asarray(each, float).reshape(-1, 3) for each in (found, true)]
    apart = cdist(*places)
    allowed = apart <= np.broadcast_to(np.asarray(reach, float), apart.shape)
    if may_be is not None:
        allowed &= may_be
    cost = np.divide(apart, reach, out=np.full(apart.shape, _NEVER), where=allowed)
    rows, columns = linear_sum_assignment(cost)
    return {
        int(column): int(row)
        for row, column in zip(rows, columns, strict=True)
        if allowed[row, column]
    }


def true_index(position: NDArray[np.float64], truth: Sequence[TrueDent]) -> int | None:
    """The true dent within whose length a position lies; the nearest of several."""
    apart = [float(np.linalg.norm(true.position - position)) for true in truth]
    near = [i for i, true in enumerate(truth) if apart[i] <= true.length / 2]
    return min(near, key=lambda i: apart[i], default=None)
