"""Which groups of known dents a frame shows, and how it has to be moved onto each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.observation import SAME
from ftp_dent_ros.inspection.tracking.constellation import find_match
from ftp_dent_ros.inspection.tracking.moves import move_about
from ftp_dent_ros.pose import Pose

# Part of a pose's error that the frame before had too: estimators drift, they do not jump.
_SHARED = 0.8


def expected_move(error: NDArray[np.float64] | None, pivot: NDArray[np.float64]) -> Pose | None:
    """Where a frame lies if its pose errs as the one before did; None where there is none before.

    Parameters
    ----------
    error : ndarray, shape (6,), optional
        Of the pose before: shift, metres, and turn, radians.
    pivot : ndarray, shape (3,)
        What the frame turns about, metres.
    """
    if error is None:
        return None
    return move_about(_SHARED * error, pivot) if error.any() else SAME


def groups_shown(
    dents: Sequence[MeasuredDent],
    known: Mapping[int, Sequence[MeasuredDent]],
    pivot: NDArray[np.float64],
    doubt: NDArray[np.float64],
    expected: Pose | None,
) -> list[tuple[int, Pose]]:
    """Groups that a frame shows, and the move onto each, the surest first.

    Parameters
    ----------
    dents : sequence of MeasuredDent
        Of the frame, where its pose puts them.
    known : mapping of int to sequence of MeasuredDent
        The dents of each group.
    pivot : ndarray, shape (3,)
        What the frame turns about, metres.
    doubt : ndarray, shape (6, 6)
        Covariance of the frame's pose, as `DentList.add` takes it.
    expected : Pose, optional
        As of `expected_move`.
    """
    found = []
    # This pose errs nearly as the one before; or both err, each by itself.
    ways = [(expected, (1 - _SHARED**2) * doubt)] if expected is not None else []
    ways.append((SAME, 2 * doubt))
    for group in sorted(known):
        for start, spread in ways:
            moved = dents if start is SAME else [dent.transformed(start) for dent in dents]
            match = find_match(moved, known[group], pivot, spread)
            if match is not None:
                found.append((match.odds, group, match.move @ start))
    best = {group: max(o for o, g, _ in found if g == group) for _, group, _ in found}
    found = [each for each in found if each[0] == best[each[1]]]
    found.sort(key=lambda each: -each[0])
    return [(group, move) for _, group, move in found]
