"""From wrapped to continuous phase within a region, run by run along the rows.

Each row's unbroken runs are integrated from one end to the other; then neighbouring rows are tied
by the whole fringe that most of their common columns vote for. Nothing is carried through pixels
outside the region, and parts that no vote ties together stay apart, each with its own label.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TURN = np.float32(2 * np.pi)


@dataclass(frozen=True)
class Unwrapped:
    """A continuous phase, known up to whole fringes in each part.

    Attributes
    ----------
    phase : ndarray, shape (rows, columns), float32
        Radians; 0 outside the region.
    part : ndarray, shape (rows, columns), int32
        Label of the part that a pixel is tied to, from 0; -1 outside the region.
    """

    phase: NDArray[np.float32]
    part: NDArray[np.int32]


def wrap(phase: NDArray) -> NDArray:
    """The phase less the nearest whole turns, within [-pi, pi]."""
    return phase - _TURN * np.rint(phase / _TURN)


def unwrap(
    wrapped: NDArray[np.float32],
    region: NDArray[np.bool_],
    jump: float = np.pi,
    integrate: Callable[..., NDArray[np.float32]] | None = None,
) -> Unwrapped:
    """Unwrap a phase map within a region.

    Parameters
    ----------
    wrapped : ndarray, shape (rows, columns), float32
        Radians, within [-pi, pi].
    region : ndarray, shape (rows, columns), bool
        Where the phase means something.
    jump : float
        Pixels one above the other whose phases differ by more than this, but for whole turns
        and the fringes' common inclination, are on different surfaces and tie no rows; radians.
    integrate : callable, optional
        Gives the phase, continuous along each run of the rows, of the wrapped one and the region:
        Itoh's integration unless given.

    Returns
    -------
    Unwrapped

    References
    ----------
    K. Itoh, Appl. Opt. 21, 2470 (1982).
    """
    if not region.any():
        return Unwrapped(np.zeros_like(wrapped), np.full(region.shape, -1, np.int32))
    along = (integrate or _itoh)(wrapped, region)
    run = np.cumsum(_begins(region), dtype=np.int32).reshape(region.shape) - 1
    turns, part = _tie_runs(along, run, region, jump)
    phase = along + _TURN * turns[run]
    return Unwrapped(phase * region, np.where(region, part[run], -1))


def _itoh(wrapped, region):
    """Integrate the wrapped differences along each run."""
    both = region[:, 1:] & region[:, :-1]
    step = np.rint(np.diff(wrapped, axis=1) * np.float32(-1 / _TURN)).astype(np.int32)
    step *= both
    along = wrapped.copy()
    # Whole numbers are summed several times as fast.
    along[:, 1:] += _TURN * np.cumsum(step, axis=1, dtype=np.int32).astype(np.float32)
    return along


def _begins(region):
    """Where runs along the rows begin."""
    begins = region.copy()
    begins[:, 1:] &= ~region[:, :-1]
    return begins


def _tie_runs(along, run, region, jump):
    """Whole turns to add to each run, and the part it belongs to."""
    count = int(run[-1, -1]) + 1
    both = region[1:] & region[:-1]
    difference = (along[1:] - along[:-1])[both]
    width = both.shape[1]
    begin = np.flatnonzero(_begins(both))
    upper, lower = run.ravel()[begin], run.ravel()[begin + width]
    last = np.flatnonzero(_begins(both[:, ::-1])[:, ::-1])
    width_of_each = last - begin + 1
    first = np.cumsum(width_of_each) - width_of_each
    turn, votes, voters = _vote(difference, first, jump)
    tied = 2 * votes > voters
    upper, lower, turn = upper[tied], lower[tied], turn[tied]
    return _settle(count, upper, lower, turn, votes[tied])


def _settle(count, upper, lower, turn, votes):
    """Turns and part of each run by its ties, those with most votes first (Kruskal's forest)."""
    parent, ahead = list(range(count)), [0.0] * count  # turns more than the parent's

    def root(run):
        more, path = 0.0, []
        while parent[run] != run:
            path.append(run)
            run = parent[run]
        for step in reversed(path):
            more += ahead[step]
            parent[step], ahead[step] = run, more
        return run, more

    order = np.argsort(-votes, kind='stable')
    for one, other, difference in zip(
        *(values[order].tolist() for values in (upper, lower, turn)), strict=True
    ):
        (first, of_one), (second, of_other) = root(one), root(other)
        if first != second:
            parent[second], ahead[second] = first, of_one - difference - of_other
    settled = np.array([root(run) for run in range(count)])
    _, begin, part = np.unique(settled[:, 0], return_index=True, return_inverse=True)
    turns = settled[:, 1].astype(np.float32)
    return turns - turns[begin][part], part.astype(np.int32)


def _vote(difference, first, jump):
    """Of each pair of runs: the turns that most columns see, how many these are, and of how many.

    `difference` holds the pairs' columns one pair after the other, each from its `first` on.
    """
    if len(first) == 0:
        return np.zeros(0, np.float32), np.zeros(0, np.intp), np.zeros(0, np.intp)
    lean = np.angle(np.exp(1j * difference[::16]).sum())  # fringes may be inclined
    turn = np.rint((difference - lean) / _TURN)
    smooth = np.abs(difference - lean - _TURN * turn) <= jump
    voters = np.diff(first, append=len(difference))
    winner = np.minimum.reduceat(turn, first)
    votes = np.add.reduceat(smooth, first, dtype=np.intp)
    for pair in np.flatnonzero(winner < np.maximum.reduceat(turn, first)):
        columns = slice(first[pair], first[pair] + voters[pair])
        choices, counts = np.unique(turn[columns][smooth[columns]], return_counts=True)
        if len(choices):
            winner[pair], votes[pair] = choices[counts.argmax()], counts.max()
    return winner, votes, voters
