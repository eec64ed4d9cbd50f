"""The list of dents that the node publishes, held against the dents that are there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.truth import TrueDent
from ftp_dent_ros.simulation.truth_matching import match_truth

# Standard uncertainties that a place may be off by: of three axes, 97 in 100 are not.
_SIGMAS = 3.0
# Sizes are a dent's within so many standard uncertainties and such a part of the true one: what
# differs more is another dent, however badly it was measured.
_SIZE_SIGMAS, _OF_SIZE = 4.0, 0.25
# After so many, whose dent is whose changes no more.
_ROUNDS = 4


def check_list(listed: NDArray[Any], truth: Sequence[TrueDent]) -> tuple[int, int]:
    """How many of the dents of a list are not there, and how many it has twice.

    Each true dent has one of the list at most: of those that lie by it within what they state of
    their places, and have its sizes, the nearest, after the autopilot's error that all have in
    common is taken off. One that is left over is listed twice where it has the place and the
    sizes of a true dent; any other is false.

    Parameters
    ----------
    listed : ndarray
        Structured, shape (n,), as of `ftp_dent_ros.ros.dent_messages.dents_from_message`, metres.
    truth : sequence of TrueDent
        In the list's frame of reference.
    """
    if not len(listed) or not truth:
        return len(listed), 0
    places = np.stack([listed[axis] for axis in 'xyz'], axis=-1).astype(float)
    there = np.stack([each.position for each in truth])
    off = places[:, None] - there
    reach = np.array([each.length / 2 for each in truth]) + _SIGMAS * np.array(
        listed['position_uncertainty'], float
    ).reshape(-1, 1)
    may_be = (np.linalg.norm(off, axis=-1) <= reach) & _sizes_agree(listed, truth)
    shift = np.zeros(3)
    for _ in range(_ROUNDS):
        # Less the shift, a place that may be lies off by twice the reach at most.
        pairs = match_truth(places - shift, there, 2 * reach, may_be)
        if pairs:
            shift = np.median([off[one, its] for its, one in pairs.items()], axis=0)
    left = np.setdiff1d(np.arange(len(listed)), list(pairs.values()))
    twice = may_be[left].any(axis=1)
    return int((~twice).sum()), int(twice.sum())


def _sizes_agree(listed: NDArray[Any], truth: Sequence[TrueDent]) -> NDArray[np.bool_]:
    """Whether listed dents have the sizes of true ones, (listed, true).

    A cut one is no deeper: its length and width are those of what its clouds show.
    """
    result = np.ones((len(listed), len(truth)), bool)
    is_cut = listed['is_cut'].astype(bool)[:, None]
    sizes = {
        'length': [max(each.length, each.width) for each in truth],
        'width': [min(each.length, each.width) for each in truth],
        'depth': [each.depth for each in truth],
    }
    for name, values in sizes.items():
        true = np.array(values)
        more = listed[name].astype(float)[:, None] - true
        sigma = np.nan_to_num(listed[f'{name}_uncertainty'].astype(float))[:, None]
        allowed = _SIZE_SIGMAS * sigma + _OF_SIZE * true
        # What is not known of a size says nothing against it.
        differs = (more > allowed) | (~is_cut & (more < -allowed))
        result &= ~differs if name == 'depth' else ~differs | is_cut
    return result
