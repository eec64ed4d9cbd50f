"""Clouds of a list whose poses are found to have been others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.inspection.tracking.journal import Entry
from ftp_dent_ros.pose import Pose

# What a dent has to be off by for its frame to be placed anew: no pose is better, metres.
_OFF = 1e-3


def is_off(entry: Entry, pose: Pose) -> bool:
    """Whether another pose puts a cloud's dents elsewhere."""
    move = pose @ entry.pose.inverse()
    places = _places([entry])
    return bool((np.linalg.norm(move.apply(places) - places, axis=1) > _OFF).any())


def placed(entry: Entry, pose: Pose) -> Entry:
    """What a cloud shows, where another pose puts it."""
    if pose is entry.pose:
        return entry
    move = pose @ entry.pose.inverse()
    dents = tuple(dent.transformed(move) for dent in entry.dents)
    return replace(entry, dents=dents, pose=pose)


def _places(entries: Sequence[Entry]) -> NDArray[np.float64]:
    """Of all dents, shape (n, 3)."""
    return np.array([dent.position for each in entries for dent in each.dents]).reshape(-1, 3)


def common_move(before: Sequence[Entry], after: Sequence[Entry]) -> Pose:
    """The move that carries all dents as one, in the mean."""
    old, new = _places(before), _places(after)
    middle, there = old.mean(axis=0), new.mean(axis=0)
    # A turn that nothing tells is none.
    held = 1e-3 * np.eye(3)
    turn, _ = Rotation.align_vectors(
        np.concatenate([new - there, held]), np.concatenate([old - middle, held])
    )
    return Pose(turn, there - turn.apply(middle))


def unmoved(before: Sequence[Entry], after: Sequence[Entry], move: Pose) -> int:
    """How many of the first clouds a move of all puts where they are to be."""
    for index, (old, new) in enumerate(zip(before, after, strict=True)):
        off = move.apply(_places([old])) - _places([new])
        if (np.linalg.norm(off, axis=1) > _OFF).any():
            return index
    return len(before)
