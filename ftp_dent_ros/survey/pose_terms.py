"""What pairs of clouds and the autopilot tell of poses, as terms of one sparse least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import changes, crossed, rotation_vectors, twists
from ftp_dent_ros.robust import geman_mcclure
from ftp_dent_ros.survey.information import RelativePose

# What an autopilot errs anew each time, metres and radians.
JITTER = np.diag([3e-3**2] * 3 + [1e-3**2] * 3)
# Where nothing says where the survey lies: metres, radians.
_ANCHOR = np.eye(6) * 1e-12
# About its guess, of a pose that nothing may tell: metres, radians.
_UNTOLD = np.diag([0.5**2] * 3 + [0.3**2] * 3)
#: Squared error, in variances a direction, at which a pair counts a quarter.
HALF = 16.0

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Node:
    """A cloud's pose: what the autopilot says of the camera, if anything, and when."""

    stated: Pose | None
    covariance: NDArray[np.float64] | None
    seconds: float
    flight: int


@dataclass(frozen=True, eq=False)
class PairLink:
    """A relative pose between two clouds, the second's seen from the first."""

    first: int
    second: int
    relative: RelativePose


def share_kept(earlier: Node, later: Node) -> float:
    """Share of an autopilot's error at one cloud that is still there at another."""
    if earlier.flight != later.flight:
        return 0.0
    # After which an autopilot's error is another one, seconds: the shortest that hovering ones
    # were seen to have; a longer one would believe more of it.
    return math.exp(-abs(later.seconds - earlier.seconds) / 5.0)


class LinkTerms:
    """Errors of n links: twists from what they tell to where poses are.

    Parameters
    ----------
    links : sequence of PairLink
    numbers : sequence of int
        Of those that are taken.
    """

    def __init__(self, links: Sequence[PairLink], numbers: Sequence[int]) -> None:
        relative = [links[k].relative for k in numbers]
        self.number = np.array(numbers, np.intp)
        poses = np.array([(links[k].first, links[k].second) for k in numbers], np.intp)
        self._first, self._second = poses.reshape(-1, 2).T
        turns = np.array([each.pose.rotation.as_matrix() for each in relative])
        self._back = np.swapaxes(turns.reshape(-1, 3, 3), 1, 2)
        self._shift = np.array([each.pose.translation for each in relative]).reshape(-1, 3)
        self._centre = np.array([each.centre for each in relative]).reshape(-1, 3)
        self._rank = np.array([each.rank for each in relative], float)
        self.information = np.array([each.information for each in relative]).reshape(-1, 6, 6)
        #: How twists change with the errors that all clouds have in common, shape (n, 6, 6).
        self.common = np.array([each.common for each in relative]).reshape(-1, 6, 6)

    def errors(self, turns: Array, places: Array) -> Array:
        """At poses of shape (all, 3, 3) and (all, 3); shape (n, 6)."""
        back = np.swapaxes(turns[self._first], 1, 2)
        off = back @ turns[self._second] @ self._back
        seen = _turned(back, places[self._second] - places[self._first])
        return twists(off, seen + _turned(off, self._centre - self._shift) - self._centre)

    def misfits(self, errors: Array) -> Array:
        """Squares of errors, in variances, a direction told; shape (n,)."""
        return squares(errors, self.information) / self._rank

    def cost(self, errors: Array, tolerance: Array | float) -> float:
        """Robust sum of squares."""
        misfits = self.misfits(errors)
        return float(self._rank @ (misfits / (1 + misfits / (HALF * tolerance))))

    def slopes(self, turns: Array, places: Array, errors: Array) -> list[tuple[Any, Array]]:
        """Numbers of each term's poses, and change of its error with the motion of each."""
        back = np.swapaxes(turns[self._first], 1, 2)
        centre = places[self._first] + _turned(turns[self._first], self._centre)
        slopes = []
        for sign, pose in ((-1, self._first), (1, self._second)):
            # A turn of a camera shifts what lies at the end of the arm.
            move = np.zeros((len(pose), 6, 6))
            move[:, :3, :3] = move[:, 3:, 3:] = back
            move[:, :3, 3:] = -back @ crossed(centre - places[pose])
            slopes.append((pose, sign * changes(errors) @ move))
        return slopes


class StatedTerms:
    """Errors of what the autopilot says: of the first pose, and how each differs from the last.

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

    def __init__(
        self, nodes: Sequence[Node], guesses: Sequence[Pose], fixed: int, anchor: int | None
    ) -> None:
        # Each pose, an earlier one and the share of its error, what is said of both, covariance.
        terms: list[tuple[int, int, float, Pose, Pose, Array]] = []
        last, earlier = -1, None
        for index in range(fixed - 1, -1, -1):
            if nodes[index].covariance is not None:
                last, earlier = index, nodes[index].stated
                break
        for index, node in enumerate(nodes[fixed:], fixed):
            stated, covariance = node.stated, node.covariance
            if stated is None or covariance is None:
                spread = _ANCHOR if index == 0 and anchor is None else _UNTOLD
                terms.append((index, index, 0.0, guesses[index], guesses[index], spread))
                continue
            if earlier is not None and nodes[last].flight == node.flight:
                keep = share_kept(nodes[last], node)
                spread = (1 - keep**2) * covariance + 2 * JITTER
                if anchor is not None:
                    # Seen from a pose that errs itself, errors differ ever more.
                    spread, keep = 2 * (1 - keep) * covariance + 2 * JITTER, 1.0
                terms.append((index, last, keep, stated, earlier, spread))
            elif anchor is None:
                terms.append((index, index, 0.0, stated, stated, covariance))
            elif nodes[anchor].flight != node.flight:
                # Of two flights' errors, neither is known.
                terms.append((index, index, 0.0, stated, stated, 2 * covariance))
            last, earlier = index, stated
        if anchor is not None:
            terms.append((anchor, anchor, 0.0, guesses[anchor], guesses[anchor], _ANCHOR))
        at, before, keeps, said, said_before, spreads = zip(*terms, strict=True)
        self._poses = [np.array(at), np.array(before)]
        self._keep = np.array(keeps)
        self._said = [
            (
                np.array([pose.rotation.as_matrix() for pose in each]),
                np.array([pose.translation for pose in each]),
            )
            for each in (said, said_before)
        ]
        self.information = np.linalg.inv(np.array(spreads)).astype(float)

    def errors(self, turns: Array, places: Array) -> Array:
        """At poses of shape (all, 3, 3) and (all, 3); shape (n, 6)."""
        now, then = (
            np.hstack([places[at] - place, rotation_vectors(turns[at] @ np.swapaxes(turn, 1, 2))])
            for at, (turn, place) in zip(self._poses, self._said, strict=True)
        )
        return now - self._keep[:, None] * then

    def slopes(self) -> list[tuple[Any, Array]]:
        """As of `LinkTerms`."""
        keep = self._keep[:, None, None] * np.eye(6)
        now, before = self._poses
        return [(before, -keep), (now, np.broadcast_to(np.eye(6), keep.shape))]


class Terms:
    """All that is told of the poses from number `fixed` on.

    Parameters
    ----------
    links : LinkTerms
    stated : StatedTerms
    fixed, count : int
        Number of the first pose that moves, and how many do.
    """

    def __init__(self, links: LinkTerms, stated: StatedTerms, fixed: int, count: int) -> None:
        self.links, self.stated, self.fixed, self.count = links, stated, fixed, count

    def errors(self, turns: Array, places: Array) -> tuple[Array, Array]:
        """Of the links and of what is stated, at poses."""
        return self.links.errors(turns, places), self.stated.errors(turns, places)

    def cost(self, errors: tuple[Array, Array], tolerance: Array | float = 1.0) -> float:
        """Robust sum of squares."""
        of_stated = squares(errors[1], self.stated.information)
        return self.links.cost(errors[0], tolerance) + float(of_stated.sum())

    def weighted(
        self, turns: Array, places: Array, errors: tuple[Array, Array], tolerance: Array | float
    ) -> tuple[csr_matrix, csr_matrix]:
        """Jacobian of the errors by the poses that move, transposed, and that times the weights.

        The weights are Geman and McClure's of robust least squares.
        """
        count = len(errors[0])
        parts = [(0, each) for each in self.links.slopes(turns, places, errors[0])]
        parts += [(count, each) for each in self.stated.slopes()]
        rows = np.concatenate([start + np.arange(len(pose)) for start, (pose, _) in parts])
        columns = np.concatenate([pose for _, (pose, _) in parts]) - self.fixed
        blocks = np.concatenate([block for _, (_, block) in parts])
        free = columns >= 0
        inside = np.arange(6)
        at = np.broadcast_to(6 * rows[free, None, None] + inside[:, None], blocks[free].shape)
        beside = np.broadcast_to(6 * columns[free, None, None] + inside, blocks[free].shape)
        total = count + len(errors[1])
        jacobian = coo_matrix(
            (blocks[free].ravel(), (beside.ravel(), at.ravel())),
            shape=(6 * self.count, 6 * total),
        ).tocsr()
        heard = geman_mcclure(self.links.misfits(errors[0]), HALF * tolerance)
        information = [heard[:, None, None] * self.links.information, self.stated.information]
        weights = bsr_matrix(
            (np.concatenate(information), np.arange(total), np.arange(total + 1)),
            shape=(6 * total, 6 * total),
        )
        return jacobian, jacobian @ weights.tocsr()


def squares(errors: Array, information: Array) -> Array:
    """Squares of errors of shape (n, 6), in variances, by their inverses; shape (n,)."""
    return (errors * _turned(information, errors)).sum(axis=1)


def _turned(turns: Array, vectors: Array) -> Array:
    return (turns @ vectors[..., None])[..., 0]
