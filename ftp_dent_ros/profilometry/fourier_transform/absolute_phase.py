"""The fringe order: whole turns to add to the unwrapped phase (eq. 14-17 of the paper).

Where the stripe runs the phase is zero; each of its points asks for a whole number of turns, and
the one that most of them ask for is taken: an integer is right or wrong, never roughly right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoStripeError

# Share of the stripe's points in a part that must agree on its order, and the fewest of them.
_AGREEMENT = 0.7
_FEWEST_POINTS = 3
_TURN = np.float32(2 * np.pi)


def fringe_order(
    phase: NDArray[np.float32],
    part: NDArray[np.int32],
    row: NDArray[np.integer],
    column: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Turns 2 pi k to add to each pixel of a relative phase.

    Parameters
    ----------
    phase : ndarray, shape (rows, columns), float32
        Unwrapped phase of the fringes, known up to whole turns in each part; radians.
    part : ndarray, shape (rows, columns), int32
        Label of the part that a pixel belongs to, -1 for none.
    row, column : ndarray, shape (points,)
        Points on the middle of the stripe, in pixels of these arrays.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        2 pi k; NaN in parts without the stripe: their order is unknown.

    Raises
    ------
    NoStripeError
        In no part do the stripe's points agree on k.
    """
    near = np.clip(row, 0, len(phase) - 1)
    left = np.clip(np.floor(column).astype(np.intp), 0, phase.shape[1] - 2)
    label = part[near, left]
    inside = (label >= 0) & (part[near, left + 1] == label)
    near, left, column, label = near[inside], left[inside], column[inside], label[inside]
    share = column - left
    seen = (1 - share) * phase[near, left] + share * phase[near, left + 1]
    wanted = np.rint(-seen / _TURN)

    turns = np.full(part.max(initial=-1) + 2, np.nan, np.float32)  # the last is for label -1
    for one in np.unique(label):
        orders, votes = np.unique(wanted[label == one], return_counts=True)
        if votes.sum() >= _FEWEST_POINTS and votes.max() >= _AGREEMENT * votes.sum():
            turns[one] = _TURN * orders[votes.argmax()]
    if np.isnan(turns).all():
        raise NoStripeError(
            "the stripe's rows do not agree on the fringe order: bring the red stripe onto a "
            'smooth part of the surface'
        )
    return turns[part]
