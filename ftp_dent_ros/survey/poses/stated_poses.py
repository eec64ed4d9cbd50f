"""What the autopilot says of the cameras' poses, as terms of their normal equations.

The autopilot's error wanders: it is nearly the same at neighbouring clouds, and forgotten after
some seconds. So its poses hold the survey in the map as one, and neighbours to each other, but
many of them do not average their common error away. That is an Ornstein-Uhlenbeck process, whose
terms join neighbours only, so that the equations stay sparse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.tracking.moves import about
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.poses.normal_equations import Array, NormalEquations, squares
from ftp_dent_ros.survey.registration.twists import rotation_vectors

# After which an autopilot's error is another one, seconds: the shortest that hovering ones were
# seen to have; a longer one would believe more of it.
_FORGOTTEN = 5.0
# What an autopilot errs anew each time, metres and radians.
_JITTER = np.diag([3e-3**2] * 3 + [1e-3**2] * 3)
# Where nothing says where the survey lies: metres, radians.
ANCHOR = np.eye(6) * 1e-12
# About its guess, of a pose that nothing may tell: metres, radians.
_UNTOLD = np.diag([0.5**2] * 3 + [0.3**2] * 3)


@dataclass(frozen=True, eq=False)
class Node:
    """A cloud's pose: what the autopilot says of the camera, if anything, and when."""

    stated: Pose | None
    covariance: NDArray[np.float64] | None
    seconds: float
    flight: int


@dataclass(frozen=True, eq=False)
class StatedTerms:
    """What is said of n poses: of one, or of how its error differs from an earlier one's.

    Attributes
    ----------
    index, before : ndarray, shape (n,), int
        Number of the pose, and of the earlier one; the same where nothing earlier is known.
    keep : ndarray, shape (n,)
        Share of the earlier one's error that is still there.
    turn, place, earlier_turn, earlier_place : ndarray, shape (n, 3, 3) or (n, 3)
        What is said of both.
    information : ndarray, shape (n, 6, 6)
    """

    index: NDArray[np.intp]
    before: NDArray[np.intp]
    keep: Array
    turn: Array
    place: Array
    earlier_turn: Array
    earlier_place: Array
    information: Array

    @classmethod
    def of(
        cls,
        nodes: Sequence[Node],
        guesses: Sequence[Pose],
        fixed: int = 0,
        anchor: int | None = None,
    ) -> StatedTerms:
        """Terms of what is said of the first, and of each how it differs from the last.

        Parameters
        ----------
        nodes : sequence of Node
        guesses : sequence of Pose
            About which those that nothing is said of lie.
        fixed : int
            Number of the first pose that moves.
        anchor : int, optional
            The pose that is taken for exact; that of the map by default.
        """
        numbers: list[tuple[int, int]] = []
        keeps: list[float] = []
        poses: list[tuple[Pose, Pose]] = []
        spreads: list[Array] = []

        def add(index: int, before: int, keep: float, said: tuple[Pose, Pose], spread: Array):
            numbers.append((index, before))
            keeps.append(keep)
            poses.append(said)
            spreads.append(spread)

        known = (k for k in range(fixed - 1, -1, -1) if nodes[k].covariance is not None)
        last = next(known, -1)
        for index in range(fixed, len(nodes)):
            node = nodes[index]
            stated, covariance = node.stated, node.covariance
            if stated is None or covariance is None:
                spread = ANCHOR if index == 0 and anchor is None else _UNTOLD
                add(index, index, 0.0, (guesses[index], guesses[index]), spread)
                continue
            earlier = nodes[last] if last >= 0 else None
            if earlier is None or earlier.stated is None or earlier.flight != node.flight:
                if anchor is None:
                    add(index, index, 0.0, (stated, stated), covariance)
                elif nodes[anchor].flight != node.flight:
                    # Of two flights' errors, neither is known.
                    add(index, index, 0.0, (stated, stated), 2 * covariance)
            else:
                keep = share_kept(earlier, node)
                spread = (1 - keep**2) * covariance + 2 * _JITTER
                if anchor is not None:
                    # Seen from a pose that errs itself, errors differ ever more.
                    spread, keep = 2 * (1 - keep) * covariance + 2 * _JITTER, 1.0
                add(index, last, keep, (stated, earlier.stated), spread)
            last = index
        at = np.array(numbers, np.intp).reshape(-1, 2)
        turns = np.array([[each.rotation.as_matrix() for each in pair] for pair in poses])
        places = np.array([[each.translation for each in pair] for pair in poses])
        turns, places = turns.reshape(-1, 2, 3, 3), places.reshape(-1, 2, 3)
        return cls(
            at[:, 0],
            at[:, 1],
            np.array(keeps),
            turns[:, 0],
            places[:, 0],
            turns[:, 1],
            places[:, 1],
            np.linalg.inv(np.array(spreads).reshape(-1, 6, 6)).astype(float),
        )

    def errors(self, turns: Array, places: Array) -> Array:
        """Of poses of shape (all, 3, 3) and (all, 3), from what is said of them; shape (n, 6)."""
        now = _off(turns[self.index], places[self.index], self.turn, self.place)
        then = _off(turns[self.before], places[self.before], self.earlier_turn, self.earlier_place)
        return now - self.keep[:, None] * then

    def squares(self, errors: Array) -> Array:
        """Squares of errors of shape (n, 6), in standard deviations, shape (n,)."""
        return squares(errors, self.information)

    def add_to(self, equations: NormalEquations, errors: Array) -> None:
        """Add the terms, which have these errors, to normal equations."""
        keep = self.keep[:, None, None] * np.eye(6)
        each = np.broadcast_to(np.eye(6), keep.shape)
        equations.add([self.before, self.index], [-keep, each], errors, self.information)


def distances(nodes: Sequence[Node], turns: Array, places: Array) -> Array:
    """Of n poses from where they are said to be, in standard deviations; 0 if nothing is said.

    Parameters
    ----------
    nodes : sequence of Node
    turns, places : ndarray, shape (n, 3, 3) and (n, 3)
    """
    result = np.zeros(len(nodes))
    said = [
        (index, node.stated, node.covariance)
        for index, node in enumerate(nodes)
        if node.stated is not None and node.covariance is not None
    ]
    if said:
        at, poses, spreads = zip(*said, strict=True)
        stated = np.stack([pose.rotation.as_matrix() for pose in poses])
        there = np.stack([pose.translation for pose in poses])
        some = list(at)
        off = _off(turns[some], places[some], stated, there)[..., None]
        squares = np.swapaxes(off, 1, 2) @ np.linalg.solve(np.stack(spreads), off)
        result[some] = np.sqrt(squares[:, 0, 0])
    return result


def relative_doubt(a: Node, b: Node, first: Pose, second: Pose) -> NDArray[np.float64]:
    """Covariance of the second camera's place seen from the first, by the autopilot alone.

    Along the first camera's axes, about the second camera.

    Parameters
    ----------
    a, b : Node
        What is said of the two.
    first, second : Pose
        Where they are.

    Raises
    ------
    ValueError
        Nothing is said of one of them.
    """
    if a.covariance is None or b.covariance is None:
        raise ValueError('the poses of two clouds are not stated')
    keep = share_kept(a, b)
    spread = (a.covariance + b.covariance) * (1 - keep) + 2 * _JITTER
    # The first one's turn moves what lies at the end of the arm.
    carried = np.zeros((6, 6))
    carried[:3, 3:] = about(second.translation - first.translation)[:, 3:]
    spread = spread + carried @ (a.covariance * (1 - keep) + _JITTER) @ carried.T
    turn = np.kron(np.eye(2), first.rotation.as_matrix())
    return turn.T @ spread @ turn


def share_kept(earlier: Node, later: Node) -> float:
    """Share of an autopilot's error at one cloud that is still there at another."""
    if earlier.flight != later.flight:
        return 0.0
    return math.exp(-abs(later.seconds - earlier.seconds) / _FORGOTTEN)


def _off(turns: Array, places: Array, stated: Array, there: Array) -> Array:
    """Shifts and turns from what is said to what is found, shape (n, 6)."""
    turned = rotation_vectors(turns @ np.swapaxes(stated, 1, 2))
    return np.concatenate([places - there, turned], axis=1)
