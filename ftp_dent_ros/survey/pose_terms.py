"""What pairs of clouds and the autopilot tell of poses, as terms of one sparse least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, csr_matrix

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
    """A cloud's pose: what the autopilot says of the camera, and when.

    Where it says nothing there is no covariance, and `stated` is a guess.
    """

    stated: Pose
    covariance: Array | None
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


class Terms:
    """Errors of all that is told of the poses from number `fixed` on, and what they weigh.

    First those of the links, as twists from what they tell to where poses are; then those of what
    the autopilot says: of the first pose, and how each differs from the last.

    Parameters
    ----------
    links : mapping of int to PairLink
        By their numbers; each tells something.
    nodes : sequence of Node
        All of them.
    fixed : int
        Number of the first pose that moves.
    anchor : int, optional
        The pose that is taken for exact; that of the map by default.
    """

    def __init__(
        self,
        links: Mapping[int, PairLink],
        nodes: Sequence[Node],
        fixed: int = 0,
        anchor: int | None = None,
    ) -> None:
        self.fixed, self.count = fixed, len(nodes) - fixed
        self.links = np.array(list(links), np.intp)
        relative = [link.relative for link in links.values()]
        turns, self._shift = _arrays([each.pose for each in relative])
        self._back = np.swapaxes(turns, 1, 2)
        self._centre = np.array([each.centre for each in relative]).reshape(-1, 3)
        self._rank = np.array([each.rank for each in relative], float)
        stated = _stated(nodes, fixed, anchor)
        at, before, keep, spreads = zip(*stated, strict=True)
        self._keep = np.array(keep)
        self._said = [_arrays([nodes[k].stated for k in each]) for each in (before, at)]
        # Numbers of each term's two poses; of links, and of what is stated.
        pairs = [(link.first, link.second) for link in links.values()]
        self._poses = np.array([*pairs, *zip(before, at, strict=True)], np.intp)
        information = [each.information for each in relative]
        self._information = np.array([*information, *np.linalg.inv(np.array(spreads))])
        #: How errors change with those that all clouds have in common, shape (terms, 6, 6).
        self.common = np.array([*(e.common for e in relative), *np.zeros((len(stated), 6, 6))])

    def errors(self, turns: Array, places: Array) -> Array:
        """At poses of shape (all, 3, 3) and (all, 3); shape (terms, 6)."""
        count = len(self.links)
        first, second = self._poses[:count].T
        back = np.swapaxes(turns[first], 1, 2)
        off = back @ turns[second] @ self._back
        seen = _turned(back, places[second] - places[first])
        of_links = twists(off, seen + _turned(off, self._centre - self._shift) - self._centre)
        then, now = (
            np.hstack([places[at] - place, rotation_vectors(turns[at] @ np.swapaxes(turn, 1, 2))])
            for at, (turn, place) in zip(self._poses[count:].T, self._said, strict=True)
        )
        return np.concatenate([of_links, now - self._keep[:, None] * then])

    def misfits(self, errors: Array) -> Array:
        """Squares of the links' errors, in variances, a direction told; shape (links,)."""
        return self._squares(errors)[: len(self.links)] / self._rank

    def cost(self, errors: Array, tolerance: Array | float = 1.0) -> float:
        """Robust sum of squares."""
        misfits = self.misfits(errors)
        of_links = self._rank @ (misfits / (1 + misfits / (HALF * tolerance)))
        return float(of_links + self._squares(errors)[len(misfits) :].sum())

    def _squares(self, errors: Array) -> Array:
        return (errors * _turned(self._information, errors)).sum(axis=1)

    def weighted(
        self, turns: Array, places: Array, errors: Array, tolerance: Array | float
    ) -> tuple[csr_matrix, csr_matrix]:
        """Jacobian of the errors by the poses that move, and that times the weights, transposed.

        The weights are Geman and McClure's of robust least squares.
        """
        count, total = len(self.links), len(errors)
        first = self._poses[:count, 0]
        back = np.swapaxes(turns[first], 1, 2)
        centre = places[first] + _turned(turns[first], self._centre)
        change = changes(errors[:count])
        blocks = np.zeros((total, 2, 6, 6))
        for side, sign in enumerate((-1, 1)):
            # A turn of a camera shifts what lies at the end of the arm.
            move = np.zeros((count, 6, 6))
            move[:, :3, :3] = move[:, 3:, 3:] = back
            move[:, :3, 3:] = -back @ crossed(centre - places[self._poses[:count, side]])
            blocks[:count, side] = sign * change @ move
        blocks[count:, 0] = -self._keep[:, None, None] * np.eye(6)
        blocks[count:, 1] = np.eye(6)
        columns = self._poses - self.fixed
        blocks[columns < 0] = 0
        jacobian = bsr_matrix(
            (blocks.reshape(-1, 6, 6), np.maximum(columns, 0).ravel(), 2 * np.arange(total + 1)),
            shape=(6 * total, 6 * self.count),
        ).tocsr()
        information = self._information.copy()
        heard = geman_mcclure(self.misfits(errors), HALF * tolerance)
        information[:count] *= heard[:, None, None]
        weights = bsr_matrix((information, np.arange(total), np.arange(total + 1)))
        return jacobian, jacobian.T @ weights.tocsr()


def _stated(
    nodes: Sequence[Node], fixed: int, anchor: int | None
) -> list[tuple[int, int, float, Array]]:
    """Of each pose an earlier one, the share of its error, and the covariance of the rest."""
    terms: list[tuple[int, int, float, Array]] = []
    told = [index for index, node in enumerate(nodes) if node.covariance is not None]
    last_told = dict(zip(told[1:], told, strict=False))
    for index, node in enumerate(nodes[fixed:], fixed):
        last = last_told.get(index)
        if node.covariance is None:
            spread = _ANCHOR if index == 0 and anchor is None else _UNTOLD
            terms.append((index, index, 0.0, spread))
        elif last is not None and nodes[last].flight == node.flight:
            keep = share_kept(nodes[last], node)
            spread = (1 - keep**2) * node.covariance + 2 * JITTER
            if anchor is not None:
                # Seen from a pose that errs itself, errors differ ever more.
                spread, keep = 2 * (1 - keep) * node.covariance + 2 * JITTER, 1.0
            terms.append((index, last, keep, spread))
        elif anchor is None:
            terms.append((index, index, 0.0, node.covariance))
        elif nodes[anchor].flight != node.flight:
            # Of two flights' errors, neither is known.
            terms.append((index, index, 0.0, 2 * node.covariance))
    if anchor is not None:
        terms.append((anchor, anchor, 0.0, _ANCHOR))
    return terms


def _arrays(poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Turns, shape (n, 3, 3), and places, shape (n, 3)."""
    turns = np.array([pose.rotation.as_matrix() for pose in poses]).reshape(-1, 3, 3)
    return turns, np.array([pose.translation for pose in poses]).reshape(-1, 3)


def _turned(turns: Array, vectors: Array) -> Array:
    return (turns @ vectors[..., None])[..., 0]
