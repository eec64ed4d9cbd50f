"""All poses of a survey at once: by what pairs of clouds tell, and what the autopilot says.

Both are terms of one sparse least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from scipy.special import expit, softmax

from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.rigid import (
    Array,
    about,
    changes,
    motions,
    rotation_vectors,
    spread_of_shift,
    twists,
)
from ftp_dent_ros.robust import geman_mcclure
from ftp_dent_ros.survey.information import COMMON, RelativePose

# What an autopilot errs anew each time, metres and radians.
JITTER = np.diag([3e-3**2] * 3 + [1e-3**2] * 3)
# About where it lies, of a pose that nothing may tell: metres, radians.
_UNTOLD = np.diag([0.5**2] * 3 + [0.3**2] * 3)
# Squared error, in variances a direction, at which a pair counts a quarter.
_HALF = 16.0


@dataclass(frozen=True, eq=False)
class Node:
    """A cloud's pose: what the autopilot says of the camera, if anything, and when."""

    stated: Pose | None
    covariance: Array | None
    seconds: float
    flight: int


@dataclass(eq=False)
class PairLink:
    """A relative pose between two clouds, the second's, which is newer, seen from the first.

    And the square of its error, in variances a direction, as poses were last found.
    """

    first: int
    second: int
    relative: RelativePose
    misfit: float = 0.0


def drift_of(errors: Array, nodes: Sequence[Node]) -> Array:
    """How an autopilot's error of a flight changes: one part is constant, the other drifts.

    The mean of all that may be, by their likelihood, for places and for turns.

    Parameters
    ----------
    errors : ndarray, shape (n, 6)
        Of poses of a flight, but for a constant that nobody knows.
    nodes : sequence of Node
        What is stated of these.

    Returns
    -------
    ndarray, shape (2, 6)
        Share of the variance that drifts, and seconds after which that is another one.
    """
    odds, times = np.linspace(-18, 6, 25), 2.5 * 2.0 ** np.arange(7)
    grid = np.array([(each, math.log(time)) for each in odds for time in times])
    spreads, seconds = _stated_of(nodes)
    off = errors / np.sqrt(spreads.diagonal(0, 1, 2))
    each = [_likelihood(off, *_chain(expit(a), math.exp(b), spreads, seconds)) for a, b in grid]
    # Of places, and of turns.
    chance = softmax(np.reshape(each, (-1, 2, 3)).sum(axis=-1), axis=0)
    share, time = np.repeat(grid.T @ chance, 3, axis=1)
    return np.stack([expit(share), np.exp(time)])


def _stated_of(nodes: Sequence[Node]) -> tuple[Array, Array]:
    """Covariances, and times, seconds, of what is stated of some poses."""
    return np.array([node.covariance for node in nodes]), np.array([n.seconds for n in nodes])


def _likelihood(off: Array, keep: Array, new: Array) -> Array:
    """Logarithm of that of errors about any constant, axis by axis."""
    steps = off - keep * np.vstack([off[:1], off[:-1]])
    weight = ((1 - keep) ** 2 / new).sum(axis=0)
    mean = ((1 - keep) * steps / new).sum(axis=0) / weight
    squares = np.square(steps - (1 - keep) * mean) / new
    return -((np.log(new) + squares).sum(axis=0) + np.log(weight)) / 2


def _chain(share: Any, seconds: Any, spreads: Array, times: Array) -> tuple[Array, Array]:
    """Errors of which a share drifts, each by the one before: what is kept, and what is new.

    Both by the axes, (n, 6); the new variance in those that are stated. An error that is another
    one each time is a part of the drift: one that changes as much from one time to the next, and
    averages out as slowly.
    """
    anew = np.diag(JITTER) / spreads.diagonal(0, 1, 2)
    # Of the first one nothing is kept.
    keep = np.exp(-np.abs(np.diff(times, prepend=-math.inf))[:, None] / seconds)
    change = share * (1 - keep) + anew
    ratio = change / (share * (1 + keep) / np.maximum(1 - keep, 1e-9) + anew)
    keep = np.maximum(1 + ratio / 2 - np.sqrt(ratio**2 / 4 + 2 * ratio), 1e-6)
    return keep, change * (1 + keep)


#: As long as a flight does not tell: all of an error drifts, and seconds after which it is another
#: one are the shortest that hovering autopilots were seen to have; a longer time would believe
#: more of it.
UNKNOWN = np.stack([np.ones(6), np.full(6, 5.0)])


class PoseGraph:
    """Poses of cameras, and what joins them; all that is known is relative or the autopilot's.

    Attributes
    ----------
    nodes : list of Node
    links : list of PairLink
    turns, places : ndarray, shape (n, 3, 3) and (n, 3)
        Of the poses, as they are found.
    drifts : dict of int to ndarray
        Of the flights that tell it, as of `drift_of`, once all poses are known.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.links: list[PairLink] = []
        self.turns, self.places = np.zeros((0, 3, 3)), np.zeros((0, 3))
        self.drifts: dict[int, Array] = {}
        self._moved_at = 0

    def add(self, node: Node, guess: Pose) -> None:
        """Another pose, about where it is guessed to be."""
        self.turns = np.concatenate([self.turns, guess.rotation.as_matrix()[None]])
        self.places = np.concatenate([self.places, guess.translation[None]])
        self.nodes.append(node)

    @property
    def placed(self) -> dict[int, list[int]]:
        """Numbers of the poses that the autopilot states, by their flights."""
        stated = [k for k, node in enumerate(self.nodes) if node.covariance is not None]
        flights = sorted({self.nodes[k].flight for k in stated})
        return {each: [k for k in stated if self.nodes[k].flight == each] for each in flights}

    @property
    def poses(self) -> list[Pose]:
        """As they are found."""
        return [self.pose(number) for number in range(len(self.nodes))]

    def pose(self, number: int) -> Pose:
        """Of a cloud's camera, as it is found."""
        return Pose(Rotation.from_matrix(self.turns[number]), self.places[number].copy())

    def put(self, number: int, pose: Pose) -> None:
        """Move one pose."""
        self.turns[number], self.places[number] = pose.rotation.as_matrix(), pose.translation

    @property
    def left_out(self) -> set[int]:
        """Numbers of the links that contradict the others."""
        # Of squared errors by the rank: from where on a pair contradicts the others.
        return {number for number, link in enumerate(self.links) if link.misfit > 36.0}

    def part(self, numbers: Sequence[int]) -> PoseGraph:
        """Some of the poses, in rising order, and what joins them, without all others.

        What the autopilot says of two says the same of them whether poses lie between or not.
        """
        place, some = {number: index for index, number in enumerate(numbers)}, PoseGraph()
        for number in numbers:
            some.add(self.nodes[number], self.pose(number))
        placed = some.placed
        some.drifts = {k: drift for k, drift in self.drifts.items() if k in placed}
        some.links = [
            replace(link, first=place[link.first], second=place[link.second])
            for link in self.links
            if link.first in place and link.second in place
        ]
        return some

    def update(self) -> None:
        """Move all poses now and then, after a pose and its links came."""
        # Clouds, and their share, after which they do.
        if len(self.nodes) - self._moved_at >= max(4, 0.1 * self._moved_at):
            self.solve()
            self._moved_at = len(self.nodes)

    def settle(self) -> None:
        """Move all poses to where they agree best, and learn how the autopilot's errors change."""
        self.drifts = {}
        self.solve()
        # What is learnt of the errors moves the poses that it is learnt from: after so many times
        # hardly any more.
        for _ in range(3):
            groups = self.groups()
            for flight, placed in self.placed.items():
                # Of poses that nothing ties, errors are not known: those of the most are taken.
                most = np.bincount(groups[placed]).argmax()
                tied = [k for k in placed if groups[k] == most]
                if len(tied) > 2:
                    nodes = [self.nodes[k] for k in tied]
                    said = _arrays([node.stated or IDENTITY for node in nodes])
                    errors = _off(self.turns[tied], self.places[tied], *said)
                    self.drifts[flight] = drift_of(errors, nodes)
            self.solve()

    def solve(self) -> None:
        """Move all poses to where they agree best."""
        terms, count = Terms(self), len(self.nodes)
        turns, places = _stepped(terms, *terms.start)
        self.turns, self.places = turns[:count], places[:count]
        misfits = terms.misfits(terms.errors(turns, places))
        for link, misfit in zip(terms.links, misfits.tolist(), strict=True):
            link.misfit = misfit

    def covariances(self, anchor: int | None = None) -> NDArray[np.float64]:
        """Covariance of every pose, shape (n, 6, 6), as in geometry_msgs/PoseWithCovariance.

        What all clouds have in common is no unknown of the solution, so poses err by all that it
        may be, whatever pairs would tell of it: a parameter considered, not estimated. Source:
        G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), ch. VIII.

        Parameters
        ----------
        anchor : int, optional
            The pose that the others are seen from; the map by default, or, where nothing says
            where that lies, the first one.
        """
        terms, blocks = Terms(self), []
        jacobian, weighted = terms.weighted(*terms.start, terms.errors(*terms.start), 1.0)
        solver = _factored(weighted @ jacobian)
        bent = solver.solve(weighted @ terms.common.reshape(-1, 6))
        if anchor is None and not self.placed:
            anchor = 0
        for number in range(len(self.nodes)):
            # How what a pose errs by changes with all that is not known.
            change = np.eye(6, len(bent), 6 * number)
            if anchor is not None:
                # The anchor's own error shifts and turns what is seen from it.
                arm = self.places[number] - self.places[anchor]
                carried = np.vstack([about(arm), np.eye(3, 6, 3)])
                change[:, 6 * anchor : 6 * anchor + 6] -= carried
            shared = change @ bent
            block = change @ solver.solve(change.T) + shared @ COMMON @ shared.T
            blocks.append((block + block.T) / 2)
        return spread_of_shift(np.array(blocks))

    def groups(self, joins: Sequence[tuple[int, int]] = ()) -> NDArray[np.intp]:
        """Number of the group that each pose belongs to: those that links join, or others."""
        size, left_out = len(self.nodes), self.left_out
        tied = (
            (link.first, link.second)
            for index, link in enumerate(self.links)
            if index not in left_out and link.relative.rank == 6
        )
        ends = np.array([*joins, *tied], int).reshape(-1, 2)
        joined = coo_matrix((np.ones(len(ends)), ends.T), shape=(size, size))
        return connected_components(joined, directed=False)[1]


def _factored(matrix: Any) -> Any:
    """Factors of a symmetric positive matrix: in an order that fills little of them."""
    return splu(
        matrix.tocsc(),
        permc_spec='MMD_AT_PLUS_A',
        diag_pivot_thresh=0.0,
        options={'SymmetricMode': True},
    )


def _stepped(terms: Terms, turns: Array, places: Array) -> tuple[Array, Array]:
    """Poses after steps of least squares: of all pairs, and then of those that agree.

    The tolerance for errors falls from step to step until it is what they state.
    """
    errors, tolerance = terms.errors(turns, places), math.inf
    for _ in range(40):
        jacobian, weighted = terms.weighted(turns, places, errors, tolerance)
        pull = weighted @ errors.ravel()
        step = _factored(weighted @ jacobian).solve(-pull)
        turns, places = _moved(turns, places, step.reshape(-1, 6))
        errors = terms.errors(turns, places)
        # Variances, of all that is known together, that a step promises and are a gain.
        if -pull @ step > 0.1 and tolerance in (1.0, math.inf):
            continue
        if tolerance == 1.0:
            break
        most = terms.misfits(errors).max(initial=0.0) / _HALF
        tolerance = max(1.0, min(tolerance, most) / 4.0)
    return turns, places


def _moved(turns: Array, places: Array, step: Array) -> tuple[Array, Array]:
    """Poses after a step.

    Each moves along its screw, so that what slides or turns as one stays as it is, however far.
    """
    turn = step[:, 3:]
    off, shift = motions(np.concatenate([step[:, :3] - np.cross(turn, places), turn], axis=1))
    return off @ turns, _turned(off, places) + shift


class Terms:
    """Errors of all that is known of the poses, and what they weigh.

    First those of the links, as twists from what they tell to where poses are; then those of what
    the autopilot says, each a sum of shares of poses' errors.

    Parameters
    ----------
    graph : PoseGraph
    """

    def __init__(self, graph: PoseGraph) -> None:
        level, nowhere = _arrays([IDENTITY] * len(graph.drifts))
        #: Turns and places of all poses, and of the flights' constant errors, from nothing on.
        self.start = np.vstack([graph.turns, level]), np.vstack([graph.places, nowhere])
        #: Those that tell something.
        self.links = [link for link in graph.links if link.relative.rank]
        relative = [link.relative for link in self.links]
        ends = [(link.first, link.second) for link in self.links]
        self._ends = np.array(ends, np.intp).reshape(-1, 2)
        turns, self._shift = _arrays([each.pose for each in relative])
        self._back = np.swapaxes(turns, 1, 2)
        self._centre = np.array([each.centre for each in relative]).reshape(-1, 3)
        self._rank = np.array([each.rank for each in relative], float)
        stated = _stated(graph)
        shares = [each for parts, _ in stated for each in parts]
        self._of, self._shares = (np.array(each) for each in zip(*shares, strict=True))
        self._begin = np.cumsum([0, *(len(parts) for parts, _ in stated)])
        # Of a pose that nothing is said of, as it is found; of a flight's error, that it is none.
        self._said = _arrays(
            [
                graph.nodes[k].stated or graph.pose(k) if k < len(graph.nodes) else IDENTITY
                for k, _ in shares
            ]
        )
        information = [each.information for each in relative]
        self._information = np.array([*information, *(np.linalg.inv(each) for _, each in stated)])
        #: How errors change with those that all clouds have in common, shape (terms, 6, 6).
        self.common = np.array([*(e.common for e in relative), *np.zeros((len(stated), 6, 6))])

    def errors(self, turns: Array, places: Array) -> Array:
        """At poses of shape (all, 3, 3) and (all, 3); shape (terms, 6)."""
        first, second = self._ends.T
        back = np.swapaxes(turns[first], 1, 2)
        off = back @ turns[second] @ self._back
        seen = _turned(back, places[second] - places[first])
        of_links = twists(off, seen + _turned(off, self._centre - self._shift) - self._centre)
        parts = self._shares * _off(turns[self._of], places[self._of], *self._said)
        return np.concatenate([of_links, np.add.reduceat(parts, self._begin[:-1])])

    def misfits(self, errors: Array) -> Array:
        """Squares of the links' errors, in variances, by their directions; shape (links,)."""
        squares = (errors * _turned(self._information, errors)).sum(axis=1)
        return squares[: len(self.links)] / self._rank

    def weighted(
        self, turns: Array, places: Array, errors: Array, tolerance: float
    ) -> tuple[csr_matrix, csr_matrix]:
        """Jacobian of the errors by the poses that move, and that times the weights, transposed.

        The weights are Geman and McClure's of robust least squares.
        """
        count, total = len(self.links), len(errors)
        first = self._ends[:, 0]
        back = np.swapaxes(turns[first], 1, 2)
        # A turn of a camera shifts what lies at the end of the arm.
        arms = (places[first] + _turned(turns[first], self._centre))[:, None] - places[self._ends]
        shifts = back[:, None] @ about(arms)
        moves = [shifts, back[:, None] @ np.broadcast_to(np.eye(3, 6, 3), shifts.shape)]
        change = changes(errors[:count])[:, None] * [[[-1]], [[1]]]
        of_links = change @ np.concatenate(moves, axis=2)
        blocks = [of_links.reshape(-1, 6, 6), self._shares[:, None] * np.eye(6)]
        columns = np.concatenate([self._ends.ravel(), self._of])
        rows = np.concatenate([2 * np.arange(count), 2 * count + self._begin])
        size = (6 * total, 6 * len(turns))
        jacobian = bsr_matrix((np.concatenate(blocks), columns, rows), size).tocsr()
        jacobian.eliminate_zeros()
        heard = geman_mcclure(self.misfits(errors), _HALF * tolerance)
        information = self._information.copy()
        information[:count] *= heard[:, None, None]
        weights = bsr_matrix((information, np.arange(total), np.arange(total + 1)))
        return jacobian, jacobian.T @ weights.tocsr()


def _stated(graph: PoseGraph) -> list[tuple[list[tuple[int, Array]], Array]]:
    """What the autopilot says: sums of shares of poses' errors, and the covariance of each.

    The error of a pose less what is left of the one before and of its flight's constant; those of
    the constants themselves; and where one is known by itself, that.
    """
    nodes, flights, whole = graph.nodes, graph.placed, np.ones(6)
    stated = [([(k, whole)], _UNTOLD) for k, node in enumerate(nodes) if node.covariance is None]
    constants = {flight: len(nodes) + k for k, flight in enumerate(graph.drifts)}
    for flight, placed in flights.items():
        spreads, times = _stated_of([nodes[k] for k in placed])
        share, seconds = graph.drifts.get(flight, UNKNOWN)
        kept, changed = _chain(share, seconds, spreads, times)
        for k, before, keep, new, spread in zip(
            placed, [placed[0], *placed[:-1]], kept, changed, spreads, strict=True
        ):
            parts = [(k, whole), (before, -keep)]
            if flight in constants:
                parts.append((constants[flight], keep - 1))
            stated.append((parts, spread * np.sqrt(np.outer(new, new))))
    for flight, constant in constants.items():
        spread, left = nodes[flights[flight][0]].covariance, 1 - graph.drifts[flight][0]
        stated.append(([(constant, whole)], np.sqrt(np.outer(left, left)) * spread))
    return stated


def _off(turns: Array, places: Array, said_turns: Array, said: Array) -> Array:
    """Errors of poses by what is said of them, shape (n, 6)."""
    off = rotation_vectors(turns @ np.swapaxes(said_turns, 1, 2))
    return np.hstack([places - said, off])


def _arrays(poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Turns, shape (n, 3, 3), and places, shape (n, 3)."""
    turns = np.array([pose.rotation.as_matrix() for pose in poses]).reshape(-1, 3, 3)
    return turns, np.array([pose.translation for pose in poses]).reshape(-1, 3)


def _turned(turns: Array, vectors: Array) -> Array:
    return (turns @ vectors[..., None])[..., 0]
