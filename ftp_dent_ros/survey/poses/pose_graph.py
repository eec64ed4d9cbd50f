"""All poses of a survey at once: by what pairs of clouds tell, and what the autopilot says."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.poses.link_terms import Link, LinkTerms
from ftp_dent_ros.survey.poses.normal_equations import Array, NormalEquations
from ftp_dent_ros.survey.poses.stated_poses import ANCHOR, Node, StatedTerms, relative_doubt
from ftp_dent_ros.survey.registration.common_errors import COMMON
from ftp_dent_ros.survey.registration.relative_pose import RelativePose
from ftp_dent_ros.survey.registration.twists import spread_of_shift

# Of squared errors by directions told: where a pair counts half, and from where on not at all.
_HALF, _WRONG = 16.0, 36.0
_STEPS, _DONE, _COARSE = 30, 1e-7, 1e-4
# By which the tolerance falls from step to step: H. Yang et al., IEEE RA-L 5, 1127 (2020).
_GRADUAL = 4.0
# Columns of the inverse that are solved for at once.
_AT_ONCE = 600


@dataclass(frozen=True, eq=False)
class _Terms:
    """All that is told of the poses from number `fixed` on, gathered for a solution."""

    fixed: int
    count: int
    links: LinkTerms
    stated: StatedTerms

    def equations(
        self, turns: Array, places: Array, weights: Array, held: Mapping[int, Array] | None = None
    ) -> NormalEquations:
        """Normal equations, or those with one more unknown: what all clouds have in common.

        That is where some unknowns are `held`: covariances, by the unknown's number.
        """
        held = held or {}
        last = self.fixed + self.count if held else None
        equations = NormalEquations(self.fixed, self.count + bool(held))
        self.links.add_to(equations, turns, places, weights, last)
        self.stated.add_to(equations, turns, places)
        for number, spread in held.items():
            information = np.linalg.inv(spread)[None].astype(float)
            equations.add([np.array([number])], [np.eye(6)[None]], np.zeros((1, 6)), information)
        return equations

    def step(self, turns: Array, places: Array, weights: Array) -> Array:
        """Shift and turn of each pose to where they agree best, shape (count, 6)."""
        # What they are made of is gone before they are solved again.
        equations = self.equations(turns, places, weights)
        return -_factored(equations.matrix()).solve(equations.gradient).reshape(-1, 6)


class PoseGraph:
    """Poses of cameras, and what joins them; all that is told is relative or the autopilot's.

    Attributes
    ----------
    nodes : list of Node
    poses, guesses : list of Pose
        As they are found, and as they were guessed.
    links : list of Link
        Each second cloud's number is no less than the last one's.
    left_out : set of int
        Numbers of the links that contradict the others.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.poses: list[Pose] = []
        self.guesses: list[Pose] = []
        self.links: list[Link] = []
        self.left_out: set[int] = set()
        # The poses once more, in arrays that grow by doubling.
        self._turns, self._places = np.zeros((16, 3, 3)), np.zeros((16, 3))

    def add(self, node: Node, guess: Pose) -> None:
        """Another pose, about where it is guessed to be."""
        number = len(self.nodes)
        if number == len(self._places):
            self._turns = np.concatenate([self._turns, np.zeros_like(self._turns)])
            self._places = np.concatenate([self._places, np.zeros_like(self._places)])
        self._turns[number] = guess.rotation.as_matrix()
        self._places[number] = guess.translation
        self.nodes.append(node)
        self.poses.append(guess)
        self.guesses.append(guess)

    def link(self, first: int, second: int, relative: RelativePose) -> None:
        """Another relative pose; the second cloud is the newer one."""
        self.links.append(Link(first, second, relative))

    def first_link(self, number: int) -> int:
        """Number of the first link to a pose or a newer one."""
        return bisect_left(self.links, number, key=lambda link: link.second)

    def part(self, numbers: Sequence[int]) -> PoseGraph:
        """Some of the poses, in rising order, and what joins them, without all others.

        What the autopilot says of two says the same of them whether poses lie between or not.
        """
        place = {number: index for index, number in enumerate(numbers)}
        some = PoseGraph()
        for number in numbers:
            some.add(self.nodes[number], self.poses[number])
        for index in range(self.first_link(numbers[0]), len(self.links)):
            link = self.links[index]
            if link.first in place and link.second in place and index not in self.left_out:
                some.links.append(
                    replace(link, first=place[link.first], second=place[link.second])
                )
        return some

    def solve(self, fixed: int = 0) -> None:
        """Move the poses from number `fixed` on to where they agree best."""
        count = len(self.nodes) - fixed
        if count <= 0:
            return
        terms = self._gathered(fixed)
        size = len(self.nodes)
        turns, places = self._turns[:size], self._places[:size]
        weights = np.ones(len(terms.links))
        tolerance = math.inf
        for _ in range(_STEPS):
            step = terms.step(turns, places, weights)
            turns[fixed:] = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ turns[fixed:]
            places[fixed:] += step[:, :3]
            if tolerance == 1 and np.abs(step).max() < _DONE:
                break
            misfits = terms.links.misfits(turns, places)
            # Graduated: first the whole falls into place, then who contradicts is heard less.
            if math.isinf(tolerance):
                if np.abs(step).max() > _COARSE:
                    continue
                tolerance = misfits.max(initial=0.0) / _HALF
            tolerance = max(1.0, tolerance / _GRADUAL)
            weights = _weights(misfits / tolerance)
        rotations = Rotation.from_matrix(turns[fixed:])
        self.poses[fixed:] = [Pose(rotations[k], places[fixed + k].copy()) for k in range(count)]
        misfits = terms.links.misfits(turns, places)
        judged = terms.links.number
        self.left_out -= set(judged.tolist())
        self.left_out |= set(judged[misfits > _WRONG].tolist())

    def follow(self, number: int) -> None:
        """Put the newest pose where its last link says, as far as that says anything."""
        link = self.links[-1]
        if link.relative.told == 6:
            pose = self.poses[link.first] @ link.relative.pose
            self.poses[number] = pose
            self._turns[number] = pose.rotation.as_matrix()
            self._places[number] = pose.translation
        else:
            self.solve(fixed=number)

    def placed(self, numbers: Sequence[int], points: Array) -> Array:
        """Points of shape (n, 3), each in its camera's frame, in the map."""
        at = np.asarray(numbers, np.intp)
        return (self._turns[at] @ points[..., None])[..., 0] + self._places[at]

    def strained(self, numbers: Sequence[int]) -> bool:
        """Whether some links, by their numbers, do not fit where the poses are."""
        told = [k for k in numbers if self.links[k].relative.told]
        terms = LinkTerms.of([self.links[k] for k in told], told)
        return bool((terms.misfits(self._turns, self._places) > _HALF).any())

    def covariances(
        self, anchor: int | None = None, only: Sequence[int] | None = None
    ) -> NDArray[np.float64]:
        """Covariance of every pose, shape (n, 6, 6), as in geometry_msgs/PoseWithCovariance.

        Parameters
        ----------
        anchor : int, optional
            The pose that is taken for exact; that of the map by default.
        only : sequence of int, optional
            Numbers of the poses that are asked for; all by default.
        """
        terms = self._gathered(0, anchor)
        weights = _weights(terms.links.misfits(self._turns, self._places))
        held = {terms.count: COMMON} | ({} if anchor is None else {anchor: ANCHOR})
        equations = terms.equations(self._turns, self._places, weights, held)
        matrix: csc_matrix = equations.matrix()
        solver = _factored(matrix)
        wanted = np.arange(terms.count) if only is None else np.asarray(only)
        blocks = np.empty((len(wanted), 6, 6))
        for start in range(0, len(wanted), _AT_ONCE // 6):
            some = wanted[start : start + _AT_ONCE // 6]
            rows = (6 * some[:, None] + np.arange(6)).ravel()
            unit = np.zeros((matrix.shape[0], len(rows)))
            unit[rows, np.arange(len(rows))] = 1
            columns = solver.solve(unit)[rows].reshape(len(some), 6, len(some), 6)
            own = columns[np.arange(len(some)), :, np.arange(len(some))]
            blocks[start : start + len(some)] = (own + np.swapaxes(own, 1, 2)) / 2
        return spread_of_shift(blocks)

    def groups(self) -> list[int]:
        """Number of the group that each pose belongs to: those that links join."""
        joins = [
            (link.first, link.second)
            for index, link in enumerate(self.links)
            if index not in self.left_out and link.relative.told == 6
        ]
        first, second = np.array(joins, int).reshape(-1, 2).T
        size = len(self.nodes)
        joined = coo_matrix((np.ones(len(joins)), (first, second)), shape=(size, size))
        return connected_components(joined, directed=False)[1].tolist()

    def relative_doubt(self, first: int, second: int) -> NDArray[np.float64]:
        """Covariance of a camera's place seen from another, by the autopilot alone."""
        nodes, poses = self.nodes, self.poses
        return relative_doubt(nodes[first], nodes[second], poses[first], poses[second])

    def _gathered(self, fixed: int, anchor: int | None = None) -> _Terms:
        told = [
            number
            for number in range(self.first_link(fixed), len(self.links))
            if self.links[number].relative.told
        ]
        links = LinkTerms.of([self.links[number] for number in told], told)
        stated = StatedTerms.of(self.nodes, self.guesses, fixed, anchor)
        return _Terms(fixed, len(self.nodes) - fixed, links, stated)


def _factored(matrix: csc_matrix) -> Any:
    """Factors of a symmetric positive matrix: in an order that fills little of them."""
    return splu(
        matrix,
        permc_spec='MMD_AT_PLUS_A',
        diag_pivot_thresh=0.0,
        options={'SymmetricMode': True},
    )


def _weights(misfits: Array) -> Array:
    """Of pairs by squared errors a direction: of Geman and McClure's robust least squares."""
    return 1 / np.square(1 + misfits / _HALF)
