"""All poses of a survey at once: by what pairs of clouds tell, and what the autopilot says.

Both are terms of one sparse least squares.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix, identity
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from scipy.special import expit

from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.rigid import (
    changes,
    crossed,
    motions,
    rotation_vectors,
    spread_of_shift,
    twists,
)
from ftp_dent_ros.robust import geman_mcclure
from ftp_dent_ros.survey.information import COMMON, RelativePose

# What an autopilot errs anew each time, metres and radians.
JITTER = np.diag([3e-3**2] * 3 + [1e-3**2] * 3)
# Where nothing says where the survey lies: metres, radians.
_ANCHOR = np.eye(6) * 1e-12
# About its guess, of a pose that nothing may tell: metres, radians.
_UNTOLD = np.diag([0.5**2] * 3 + [0.3**2] * 3)
# Squared error, in variances a direction, at which a pair counts a quarter.
_HALF = 16.0

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


def share_kept(earlier: Node, later: Node, seconds: Any = 5.0) -> Any:
    """Share of an autopilot's error at one cloud that is still there at another.

    Parameters
    ----------
    earlier, later : Node
    seconds : float or ndarray
        After which it is another one: by default the shortest that hovering ones were seen to
        have; a longer one would believe more of it.
    """
    is_same = earlier.flight == later.flight
    return is_same * np.exp(-abs(later.seconds - earlier.seconds) / seconds)


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
    odds, times = np.linspace(-18, 6, 25), np.log(2.5 * 2.0 ** np.arange(7))
    sigmas = np.sqrt(np.array([node.covariance for node in nodes], float).diagonal(0, 1, 2))
    gaps = np.diff([node.seconds for node in nodes])[:, None]
    off, parts = errors / sigmas, list[Array]()
    anew = np.diag(JITTER) / sigmas[1:] ** 2
    grid = np.array([(each, time) for each in odds for time in times])
    for part in (slice(0, 3), slice(3, 6)):
        likelihood = [
            _likelihood(off[:, part], np.exp(-gaps / math.exp(time)), expit(each), anew[:, part])
            for each, time in grid
        ]
        chance = np.exp(np.array(likelihood) - max(likelihood))
        parts += 3 * [np.average(grid, axis=0, weights=chance)]
    share, time = np.array(parts).T
    return np.stack([expit(share), np.exp(time)])


def _likelihood(off: Array, keep: Array, share: float, anew: Array) -> float:
    """Logarithm of that of errors about any constant, of which a share drifts."""
    keep, part = _as_chain(share, keep, anew)
    steps = np.concatenate([off[:1], off[1:] - keep * off[:-1]])
    constant = np.concatenate([np.ones((1, 3)), 1 - keep])
    variance = np.concatenate([part[:1], (1 - keep**2) * part])
    weight = (constant**2 / variance).sum(axis=0)
    mean = (constant * steps / variance).sum(axis=0) / weight
    squares = np.square(steps - constant * mean) / variance
    return -float((np.log(variance) + squares).sum() + np.log(weight).sum()) / 2


def _as_chain(share: Any, keep: Any, anew: Any) -> tuple[Any, Any]:
    """A drift, and what is another error each time, as one drift: what it keeps, its variance.

    That one changes as much from one time to the next, and averages out as slowly.
    """
    change = share * (1 - keep) + anew
    lasting = share * (1 + keep) / np.maximum(1 - keep, 1e-9) + anew
    ratio = change / lasting
    keep = np.maximum(1 + ratio / 2 - np.sqrt(ratio**2 / 4 + 2 * ratio), 1e-6)
    return keep, change / (1 - keep)


# As long as a flight does not tell: all of an error drifts.
_UNKNOWN = np.stack([np.ones(6), np.full(6, 5.0)])


class PoseGraph:
    """Poses of cameras, and what joins them; all that is known is relative or the autopilot's.

    Attributes
    ----------
    nodes : list of Node
    links : list of PairLink
        Each second cloud's number is no less than the last one's.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.links: list[PairLink] = []
        # Squares of the links' errors, in variances a direction, as poses were last found.
        self._misfits: dict[int, float] = {}
        # Of the poses.
        self._turns, self._places = np.zeros((0, 3, 3)), np.zeros((0, 3))
        self._all_moved = 0
        #: Of the flights that tell it, as of `drift_of`, once all poses are known.
        self.drifts: dict[int, Array] = {}

    def add(self, node: Node, guess: Pose) -> None:
        """Another pose, about where it is guessed to be."""
        self._turns = np.concatenate([self._turns, guess.rotation.as_matrix()[None]])
        self._places = np.concatenate([self._places, guess.translation[None]])
        self.nodes.append(node)

    @property
    def placed(self) -> dict[int, list[int]]:
        """Numbers of the poses that the autopilot tells, by their flights."""
        placed = dict[int, list[int]]()
        for number, node in enumerate(self.nodes):
            if node.covariance is not None:
                placed.setdefault(node.flight, []).append(number)
        return placed

    @property
    def poses(self) -> list[Pose]:
        """As they are found."""
        return [self.pose(number) for number in range(len(self.nodes))]

    def pose(self, number: int) -> Pose:
        """Of a cloud's camera, as it is found."""
        return Pose(Rotation.from_matrix(self._turns[number]), self._places[number].copy())

    def carry(self, move: Pose) -> None:
        """Move all poses, that are guesses alone."""
        for number in range(len(self.nodes)):
            pose = move @ self.pose(number)
            self.nodes[number] = replace(self.nodes[number], stated=pose)
            self._put(number, pose)

    def link(self, first: int, second: int, relative: RelativePose) -> None:
        """Another relative pose; the second cloud is the newer one."""
        self.links.append(PairLink(first, second, relative))

    @property
    def left_out(self) -> set[int]:
        """Numbers of the links that contradict the others."""
        # Of squared errors by the rank: from where on a pair contradicts the others.
        return {number for number, misfit in self._misfits.items() if misfit > 36.0}

    def first_link(self, number: int) -> int:
        """Number of the first link to a pose or a newer one."""
        return bisect_left(self.links, number, key=lambda link: link.second)

    def part(self, numbers: Sequence[int]) -> PoseGraph:
        """Some of the poses, in rising order, and what joins them, without all others.

        What the autopilot says of two says the same of them whether poses lie between or not.
        """
        place = {number: index for index, number in enumerate(numbers)}
        some, start = PoseGraph(), self.first_link(numbers[0])
        for number in numbers:
            some.add(self.nodes[number], self.pose(number))
        flights = some.placed.keys() & self.drifts.keys()
        some.drifts = {flight: self.drifts[flight] for flight in flights}
        for index, link in enumerate(self.links[start:], start):
            if link.first in place and link.second in place:
                some._misfits[len(some.links)] = self._misfits.get(index, 0.0)
                some.link(place[link.first], place[link.second], link.relative)
        return some

    def update(self) -> None:
        """Move the last poses, and now and then all, after a pose and its links came."""
        number = len(self.nodes) - 1
        # Poses that move as each cloud comes; and clouds, and their share, after which all do.
        self.solve(max(0, number - 20))
        if number - self._all_moved >= max(4, 0.05 * number):
            self.solve()
            self._all_moved = number

    def settle(self) -> None:
        """Move all poses to where they agree best, and learn how the autopilot's errors change."""
        self.drifts = {}
        self.solve()
        # What is learnt of the errors moves the poses that it is learnt from: after so many times
        # hardly any more.
        for _ in range(3):
            groups, drifts = self.groups(), {}
            for flight, placed in self.placed.items():
                # Of poses that nothing ties, errors are not known: those of the most are taken.
                most = np.bincount(groups[placed]).argmax()
                tied = [k for k in placed if groups[k] == most]
                if len(tied) > 2:
                    nodes = [self.nodes[k] for k in tied]
                    said = _arrays([node.stated for node in nodes])
                    errors = _off(self._turns[tied], self._places[tied], *said)
                    drifts[flight] = drift_of(errors, nodes)
            self.drifts = drifts
            self.solve()

    def solve(self, fixed: int = 0) -> None:
        """Move the poses from number `fixed` on to where they agree best."""
        terms = Terms(self, fixed)
        turns, places = _stepped(terms, *self._start())
        count = len(self.nodes)
        self._turns, self._places = turns[:count], places[:count]
        misfits = terms.misfits(terms.errors(turns, places))
        self._misfits |= dict(zip(terms.links, misfits.tolist(), strict=True))

    def _start(self) -> tuple[Array, Array]:
        """Turns and places of all poses, and of the flights' constant errors, from nothing on."""
        turns, places = _arrays([IDENTITY] * len(self.drifts))
        return np.concatenate([self._turns, turns]), np.concatenate([self._places, places])

    def _put(self, number: int, pose: Pose) -> None:
        self._turns[number], self._places[number] = pose.rotation.as_matrix(), pose.translation

    def follow(self, number: int) -> None:
        """Put the newest pose where its last link says."""
        link = self.links[-1]
        self._put(number, self.pose(link.first) @ link.relative.pose)

    def in_map(self, numbers: Sequence[int], points: Sequence[Array]) -> Array:
        """Points of shape (n, 3), each in its camera's frame, in the map."""
        at = np.asarray(numbers, np.intp)
        return (self._turns[at] @ np.stack(points)[..., None])[..., 0] + self._places[at]

    def covariances(
        self, anchor: int | None = None, only: Sequence[int] | None = None
    ) -> NDArray[np.float64]:
        """Covariance of every pose, shape (n, 6, 6), as in geometry_msgs/PoseWithCovariance.

        What all clouds have in common is no unknown of the solution, so poses err by all that it
        may be, whatever pairs would tell of it: a parameter considered, not estimated. Source:
        G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), ch. VIII.

        Parameters
        ----------
        anchor : int, optional
            The pose that is taken for exact; that of the map by default.
        only : sequence of int, optional
            Numbers of the poses that are asked for; all by default.
        """
        terms = Terms(self, 0, anchor)
        start = self._start()
        errors = terms.errors(*start)
        jacobian, weighted = terms.weighted(*start, errors, 1.0)
        solver = _factored(weighted @ jacobian)
        bent = solver.solve(weighted @ terms.common.reshape(-1, 6)).reshape(-1, 6, 6)
        units, blocks = identity(6 * terms.count, format='csc'), []
        for number in range(len(self.nodes)) if only is None else only:
            own = slice(6 * number, 6 * number + 6)
            block = solver.solve(units[:, own].toarray())[own]
            block = block + bent[number] @ COMMON @ bent[number].T
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
        step = -_factored(weighted @ jacobian).solve(weighted @ errors.ravel()).reshape(-1, 6)
        there = _moved(turns, places, terms.fixed, step)
        off = terms.errors(*there)
        gain = terms.cost(errors, tolerance) - terms.cost(off, tolerance)
        if gain > 0:
            (turns, places), errors = there, off
        # Variances, of all that is known together, that are no gain.
        is_gain = gain > 0.1
        if is_gain and math.isinf(tolerance):
            continue
        if tolerance == 1 and not is_gain:
            break
        if math.isinf(tolerance):
            tolerance = terms.misfits(errors).max(initial=0.0) / _HALF
        tolerance = max(1.0, tolerance / 4.0)
    return turns, places


def _moved(turns: Array, places: Array, fixed: int, step: Array) -> tuple[Array, Array]:
    """Poses after a step of those from a number on.

    Each moves along its screw, so that what slides or turns as one stays as it is, however far.
    """
    turns, places = turns.copy(), places.copy()
    at, turn = places[fixed:], step[:, 3:]
    off, shift = motions(np.concatenate([step[:, :3] - np.cross(turn, at), turn], axis=1))
    turns[fixed:] = off @ turns[fixed:]
    places[fixed:] = (off @ at[..., None])[..., 0] + shift
    return turns, places


class Terms:
    """Errors of all that is known of the poses from number `fixed` on, and what they weigh.

    First those of the links, as twists from what they tell to where poses are; then those of what
    the autopilot says: of the first pose, and how each differs from the last.

    Parameters
    ----------
    graph : PoseGraph
    fixed : int
        Number of the first pose that moves.
    anchor : int, optional
        The pose that is taken for exact; that of the map by default.
    """

    def __init__(self, graph: PoseGraph, fixed: int = 0, anchor: int | None = None) -> None:
        nodes = graph.nodes
        #: Of the poses that move, and of the constant errors of flights, which follow them.
        self.fixed, self.count = fixed, len(nodes) + len(graph.drifts) - fixed
        numbers = range(graph.first_link(fixed), len(graph.links))
        #: Numbers of the links that tell something.
        self.links = [k for k in numbers if graph.links[k].relative.rank]
        links = [graph.links[k] for k in self.links]
        relative = [link.relative for link in links]
        turns, self._shift = _arrays([each.pose for each in relative])
        self._back = np.swapaxes(turns, 1, 2)
        self._centre = np.array([each.centre for each in relative]).reshape(-1, 3)
        self._rank = np.array([each.rank for each in relative], float)
        stated = _stated(graph, fixed, anchor)
        pairs = [*((link.first, link.second) for link in links), *(pair for pair, _ in stated)]
        #: Numbers of each term's two poses.
        self._poses = np.array(pairs, np.intp).reshape(-1, 2)
        self._apart = np.diff(self._poses[len(links) :]) != 0
        said = [*(node.stated for node in nodes), *[IDENTITY] * len(graph.drifts)]
        self._said = [_arrays([said[k] for k in each]) for each in self._poses[len(links) :].T]
        information = [each.information for each in relative]
        self._information = np.array([*information, *(np.linalg.inv(each) for _, each in stated)])
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
        other, own = (
            _off(turns[at], places[at], *said)
            for at, said in zip(self._poses[count:].T, self._said, strict=True)
        )
        return np.concatenate([of_links, own - self._apart * other])

    def misfits(self, errors: Array) -> Array:
        """Squares of the links' errors, in variances, by their directions; shape (links,)."""
        return self._squares(errors)[: len(self.links)] / self._rank

    def cost(self, errors: Array, tolerance: Array | float = 1.0) -> float:
        """Robust sum of squares."""
        misfits = self.misfits(errors)
        of_links = self._rank @ (misfits / (1 + misfits / (_HALF * tolerance)))
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
        blocks[count:, 0] = self._apart[..., None] * -np.eye(6)
        blocks[count:, 1] = np.eye(6)
        columns = self._poses - self.fixed
        blocks[columns < 0] = 0
        jacobian = bsr_matrix(
            (blocks.reshape(-1, 6, 6), np.maximum(columns, 0).ravel(), 2 * np.arange(total + 1)),
            shape=(6 * total, 6 * self.count),
        ).tocsr()
        jacobian.eliminate_zeros()
        information = self._information.copy()
        heard = geman_mcclure(self.misfits(errors), _HALF * tolerance)
        information[:count] *= heard[:, None, None]
        weights = bsr_matrix((information, np.arange(total), np.arange(total + 1)))
        return jacobian, jacobian.T @ weights.tocsr()


def _stated(
    graph: PoseGraph, fixed: int, anchor: int | None
) -> list[tuple[tuple[int, int], Array]]:
    """What the autopilot says: numbers of two poses, and how much their errors may differ.

    They are a pose and the last one, or a pose and its flight's constant: a drift is near to both.
    Where one error is known by itself, its number stands there twice.
    """
    nodes, flights = graph.nodes, graph.placed
    is_adrift = anchor is None and not flights
    terms = [
        ((k, k), _UNTOLD if k or not is_adrift else _ANCHOR)
        for k in range(fixed, len(nodes))
        if nodes[k].covariance is None
    ]
    constants = {flight: len(nodes) + k for k, flight in enumerate(graph.drifts)}
    for flight, placed in flights.items():
        share, seconds = graph.drifts.get(flight, _UNKNOWN)
        some = placed[max(0, bisect_left(placed, fixed) - 1) :]
        spreads = np.array([nodes[k].covariance for k in some])
        anew = np.diag(JITTER) / np.diagonal(spreads, axis1=1, axis2=2)
        kept = np.array([share_kept(nodes[a], nodes[b], seconds) for a, b in pairwise(some)])
        keep, part = _as_chain(share, kept.reshape(-1, 6), anew[1:])
        nothing = np.zeros((1, 6))
        before, after = np.vstack([nothing, keep]), np.vstack([keep, nothing])
        own = np.vstack([share + anew[:1], part]) / (1 / (1 + before) - after / (1 + after))
        apart = part * (1 - keep**2) / keep
        for k, index in enumerate(some):
            if index >= fixed:
                terms.append(((constants.get(flight, index), index), _part(spreads[k], own[k])))
            if index >= fixed and k:
                terms.append(((some[k - 1], index), _part(spreads[k], apart[k - 1])))
    for flight, at in constants.items():
        first = nodes[flights[flight][0]].covariance
        terms.append(((at, at), _part(first, 1 - graph.drifts[flight][0])))
    if anchor is not None:
        terms.append(((anchor, anchor), _ANCHOR))
    return terms


def _part(covariance: Any, share: Array) -> Array:
    """Covariance of which so much is left, axis by axis."""
    root = np.sqrt(share)
    return np.asarray(covariance * np.outer(root, root))


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
