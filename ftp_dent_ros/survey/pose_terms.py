"""What pairs of clouds and the autopilot tell of poses, as terms of sparse normal equations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import about, changes, crossed, rotation_vectors, twists
from ftp_dent_ros.survey.information import RelativePose

# What an autopilot errs anew each time, metres and radians.
_JITTER = np.diag([3e-3**2] * 3 + [1e-3**2] * 3)
# Where nothing says where the survey lies: metres, radians.
ANCHOR = np.eye(6) * 1e-12
# About its guess, of a pose that nothing may tell: metres, radians.
_UNTOLD = np.diag([0.5**2] * 3 + [0.3**2] * 3)

Array = NDArray[np.float64]


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


def relative_doubt(a: Node, b: Node, first: Pose, second: Pose) -> NDArray[np.float64]:
    """Covariance of the second camera's place seen from the first, by the autopilot alone.

    Along the first camera's axes, about the second camera.

    Parameters
    ----------
    a, b : Node
        What is said of the two.
    first, second : Pose
        Where they are.
    """
    assert a.covariance is not None and b.covariance is not None
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
    # After which an autopilot's error is another one, seconds: the shortest that hovering ones
    # were seen to have; a longer one would believe more of it.
    return math.exp(-abs(later.seconds - earlier.seconds) / 5.0)


def _off(turns: Array, places: Array, stated: Array, there: Array) -> Array:
    """Shifts and turns from what is said to what is found, shape (n, 6)."""
    turned = rotation_vectors(turns @ np.swapaxes(stated, 1, 2))
    return np.concatenate([places - there, turned], axis=1)


def squares(errors: Array, information: Array) -> Array:
    """Squares of errors, in standard deviations, shape (n,).

    Parameters
    ----------
    errors : ndarray, shape (n, 6)
    information : ndarray, shape (n, 6, 6)
        Inverses of the errors' covariances.
    """
    return (errors * (information @ errors[..., None])[..., 0]).sum(axis=1)


class NormalEquations:
    """Normal equations, gathered from terms; poses before the first are fixed.

    Parameters
    ----------
    fixed : int
        Number of the first pose that moves.
    count : int
        Poses that move.

    Attributes
    ----------
    gradient : ndarray, shape (6 count,)
    """

    def __init__(self, fixed: int, count: int) -> None:
        self._fixed, self._count = fixed, count
        self.gradient = np.zeros(6 * count)
        self._rows: list[NDArray[np.intp]] = []
        self._columns: list[NDArray[np.intp]] = []
        self._blocks: list[Array] = []

    def add(
        self,
        poses: Sequence[NDArray[np.intp]],
        moves: Sequence[Array],
        errors: Array,
        information: Array,
    ) -> None:
        """Add errors of some poses, how they change with each of them, and what they weigh.

        Parameters
        ----------
        poses : sequence of ndarray, shape (n,)
            Numbers of the first pose, of the second, and so on, of each of n errors.
        moves : sequence of ndarray, shape (n, 6, 6)
            Change of the errors with a small shift and turn of each.
        errors : ndarray, shape (n, 6)
        information : ndarray, shape (n, 6, 6)
            Inverses of the errors' covariances.
        """
        gradient = self.gradient.reshape(-1, 6)
        for pose, move in zip(poses, moves, strict=True):
            free = pose >= self._fixed
            held = np.swapaxes(move, 1, 2) @ information
            np.add.at(gradient, pose[free] - self._fixed, (held @ errors[..., None])[free][..., 0])
            for other, change in zip(poses, moves, strict=True):
                both = free & (other >= self._fixed)
                self._rows.append(pose[both] - self._fixed)
                self._columns.append(other[both] - self._fixed)
                self._blocks.append(held[both] @ change[both])

    def matrix(self) -> csc_matrix:
        """Matrix of the equations, shape (6 count, 6 count)."""
        size = 6 * self._count
        # Half the memory of whole words, of which there are 72 a block.
        rows, columns = (
            np.concatenate(each).astype(np.int32) for each in (self._rows, self._columns)
        )
        blocks = np.concatenate(self._blocks)
        inside = np.arange(6, dtype=np.int32)
        at = np.broadcast_to(6 * rows[:, None, None] + inside[:, None], blocks.shape)
        beside = np.broadcast_to(6 * columns[:, None, None] + inside, blocks.shape)
        entries = (blocks.ravel(), (at.ravel(), beside.ravel()))
        return coo_matrix(entries, shape=(size, size)).tocsc()


@dataclass(frozen=True, eq=False)
class PairLink:
    """A relative pose between two clouds, the second's seen from the first."""

    first: int
    second: int
    relative: RelativePose

    @cached_property
    def turn(self) -> Array:
        """Of the second seen from the first, shape (3, 3)."""
        return self.relative.pose.rotation.as_matrix()


@dataclass(frozen=True, eq=False)
class LinkTerms:
    """Links in arrays.

    Attributes
    ----------
    number, first, second : ndarray, shape (n,), int
        Of the link, and of its poses.
    turn, shift : ndarray, shape (n, 3, 3) and (n, 3)
        Of the second seen from the first.
    centre : ndarray, shape (n, 3)
    information : ndarray, shape (n, 6, 6)
    rank : ndarray, shape (n,)
        Directions known.
    common : ndarray, shape (n, 6, 6)
        How twists change with the errors that all clouds have in common.
    """

    number: NDArray[np.intp]
    first: NDArray[np.intp]
    second: NDArray[np.intp]
    turn: Array
    shift: Array
    centre: Array
    information: Array
    rank: Array
    common: Array

    @classmethod
    def of(cls, links: Sequence[PairLink], numbers: Sequence[int]) -> LinkTerms:
        """Terms of links, and the links' numbers."""
        relative = [link.relative for link in links]
        count = len(links)
        return cls(
            np.array(numbers, np.intp),
            np.array([link.first for link in links], np.intp),
            np.array([link.second for link in links], np.intp),
            np.array([link.turn for link in links]).reshape(count, 3, 3),
            np.array([each.pose.translation for each in relative]).reshape(count, 3),
            np.array([each.centre for each in relative]).reshape(count, 3),
            np.array([each.information for each in relative]).reshape(count, 6, 6),
            np.array([each.rank for each in relative], float),
            np.array([each.common for each in relative]).reshape(count, 6, 6),
        )

    def __len__(self) -> int:
        return len(self.number)

    def errors(self, turns: Array, places: Array) -> Array:
        """Twists from what links tell to where poses are, shape (n, 6).

        Parameters
        ----------
        turns, places : ndarray, shape (all, 3, 3) and (all, 3)
            Of all poses.
        """
        back = np.swapaxes(turns[self.first], 1, 2)
        off = back @ turns[self.second] @ np.swapaxes(self.turn, 1, 2)
        seen = _turned(back, places[self.second] - places[self.first])
        shift = seen + _turned(off, self.centre - self.shift) - self.centre
        return twists(off, shift)

    def misfits(self, turns: Array, places: Array) -> Array:
        """Squared errors by what links state, a direction told, shape (n,)."""
        return self.squares(self.errors(turns, places))

    def squares(self, errors: Array) -> Array:
        """The same of errors of shape (n, 6)."""
        return squares(errors, self.information) / self.rank

    def add_to(
        self,
        equations: NormalEquations,
        turns: Array,
        places: Array,
        errors: Array,
        weights: Array,
        common: int | None = None,
    ) -> None:
        """Add the links at poses, where they have these errors, weighted, to normal equations.

        Parameters
        ----------
        equations : NormalEquations
        turns, places, errors, weights : ndarray, shape (all, 3, 3), (all, 3), (n, 6) and (n,)
        common : int, optional
            Number of the unknown of what all clouds have in common, beyond the poses.
        """
        back = np.swapaxes(turns[self.first], 1, 2)
        centre = places[self.first] + _turned(turns[self.first], self.centre)
        change = changes(errors)
        moves = []
        for pose in (self.first, self.second):
            # A turn of a camera shifts what lies at the end of the arm.
            move = np.zeros((len(self), 6, 6))
            move[:, :3, :3] = move[:, 3:, 3:] = back
            move[:, :3, 3:] = -back @ crossed(centre - places[pose])
            moves.append(change @ move)
        information = weights[:, None, None] * self.information
        unknowns, slopes = [self.first, self.second], [-moves[0], moves[1]]
        if common is not None:
            unknowns.append(np.full(len(self), common))
            slopes.append(self.common)
        equations.add(unknowns, slopes, errors, information)


def _turned(turns: Array, vectors: Array) -> Array:
    return (turns @ vectors[..., None])[..., 0]
