"""All poses of a survey at once: by what pairs of clouds tell, and what the autopilot says."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import motions, spread_of_shift
from ftp_dent_ros.survey.information import COMMON, RelativePose
from ftp_dent_ros.survey.pose_terms import HALF, Array, Node, PairLink, Terms


class PoseGraph:
    """Poses of cameras, and what joins them; all that is told is relative or the autopilot's.

    Attributes
    ----------
    nodes : list of Node
    poses : list of Pose
        As they are found.
    links : list of PairLink
        Each second cloud's number is no less than the last one's.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.poses: list[Pose] = []
        self.links: list[PairLink] = []
        # Squares of the links' errors, in variances a direction, as poses were last found.
        self._misfits: dict[int, float] = {}
        # The poses once more, in arrays.
        self._turns, self._places = np.zeros((0, 3, 3)), np.zeros((0, 3))
        self._all_moved, self._is_strained = 0, False

    def add(self, node: Node, guess: Pose) -> None:
        """Another pose, about where it is guessed to be."""
        self._turns = np.concatenate([self._turns, guess.rotation.as_matrix()[None]])
        self._places = np.concatenate([self._places, guess.translation[None]])
        self.nodes.append(node)
        self.poses.append(guess)

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
        left_out = self.left_out
        some = PoseGraph()
        for number in numbers:
            some.add(self.nodes[number], self.poses[number])
        for index in range(self.first_link(numbers[0]), len(self.links)):
            link = self.links[index]
            if link.first in place and link.second in place and index not in left_out:
                some.links.append(
                    replace(link, first=place[link.first], second=place[link.second])
                )
        return some

    def update(self) -> None:
        """Move the last poses, and all where that does not do, after a pose and its links came."""
        number = len(self.nodes) - 1
        # Poses that move as clouds come. All move where a pair with an earlier one strains them,
        # but for a rest of this share of them; and at once after so many clouds, and such a share.
        fixed = max(0, number - 20)
        self.solve(fixed)
        newest = range(self.first_link(number), len(self.links))
        self._is_strained |= any(
            self._misfits.get(k, 0.0) > HALF for k in newest if self.links[k].first < fixed
        )
        rested = number - self._all_moved
        is_due = rested >= max(100, 0.25 * number)
        if is_due or (self._is_strained and rested >= 0.02 * number):
            self.solve()
            self._all_moved, self._is_strained = number, False

    def solve(self, fixed: int = 0) -> None:
        """Move the poses from number `fixed` on to where they agree best."""
        if fixed >= len(self.nodes):
            return
        terms = self._terms(fixed)
        doubted = np.isin(terms.links, list(self.left_out) if fixed else [])
        turns, places = _solved(terms, self._turns, self._places, doubted)
        self._turns, self._places = turns, places
        rotations = Rotation.from_matrix(turns[fixed:])
        self.poses[fixed:] = [
            Pose(rotation, place.copy())
            for rotation, place in zip(rotations, places[fixed:], strict=True)
        ]
        misfits = terms.misfits(terms.errors(turns, places))
        self._misfits |= dict(zip(terms.links.tolist(), misfits.tolist(), strict=True))

    def follow(self, number: int) -> None:
        """Put the newest pose where its last link says, as far as that says anything."""
        link = self.links[-1]
        if link.relative.rank == 6:
            pose = self.poses[link.first] @ link.relative.pose
            self.poses[number] = pose
            self._turns[number] = pose.rotation.as_matrix()
            self._places[number] = pose.translation
        else:
            self.solve(fixed=number)

    def placed(self, numbers: Sequence[int], points: Sequence[Array]) -> Array:
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
        terms = self._terms(0, anchor)
        errors = terms.errors(self._turns, self._places)
        jacobian, weighted = terms.weighted(self._turns, self._places, errors, 1.0)
        solver = _factored(weighted @ jacobian)
        bent = solver.solve(weighted @ terms.common.reshape(-1, 6)).reshape(-1, 6, 6)
        wanted = np.arange(terms.count) if only is None else np.asarray(only)
        blocks = np.empty((len(wanted), 6, 6))
        for index, number in enumerate(wanted):
            unit = np.zeros((6 * terms.count, 6))
            unit[6 * number : 6 * number + 6] = np.eye(6)
            own = solver.solve(unit)[6 * number : 6 * number + 6]
            own = own + bent[number] @ COMMON @ bent[number].T
            blocks[index] = (own + own.T) / 2
        return spread_of_shift(blocks)

    def groups(self) -> list[int]:
        """Number of the group that each pose belongs to: those that links join."""
        left_out = self.left_out
        joins = [
            (link.first, link.second)
            for index, link in enumerate(self.links)
            if index not in left_out and link.relative.rank == 6
        ]
        first, second = np.array(joins, int).reshape(-1, 2).T
        size = len(self.nodes)
        joined = coo_matrix((np.ones(len(joins)), (first, second)), shape=(size, size))
        return connected_components(joined, directed=False)[1].tolist()

    def _terms(self, fixed: int, anchor: int | None = None) -> Terms:
        numbers = range(self.first_link(fixed), len(self.links))
        told = {k: self.links[k] for k in numbers if self.links[k].relative.rank}
        return Terms(told, self.nodes, fixed, anchor)


def _solved(
    terms: Terms, turns: Array, places: Array, doubted: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Poses that agree best, from where they are; they fit no worse than that.

    Parameters
    ----------
    terms : Terms
    turns, places : ndarray, shape (all, 3, 3) and (all, 3)
        Of all poses.
    doubted : ndarray, shape (links,), bool
        Links that contradicted the others before: they count from the first step on by how they
        fit.

    Returns
    -------
    turns, places : ndarray, shape (all, 3, 3) and (all, 3)
    """
    found = _stepped(terms, turns, places, doubted, math.inf)
    if terms.cost(terms.errors(*found)) > terms.cost(terms.errors(turns, places)):
        # No pair that does not fit already pulls.
        return _stepped(terms, turns, places, np.ones(len(doubted), bool), 1.0)
    return found


def _factored(matrix: Any) -> Any:
    """Factors of a symmetric positive matrix: in an order that fills little of them."""
    return splu(
        matrix.tocsc(),
        permc_spec='MMD_AT_PLUS_A',
        diag_pivot_thresh=0.0,
        options={'SymmetricMode': True},
    )


def _stepped(
    terms: Terms, turns: Array, places: Array, doubted: NDArray[np.bool_], tolerance: float
) -> tuple[Array, Array]:
    """Poses after steps at tolerances that fall to 1, from a first one."""
    errors = terms.errors(turns, places)
    for _ in range(40):
        each = np.where(doubted, 1.0, tolerance)
        jacobian, weighted = terms.weighted(turns, places, errors, each)
        gradient = weighted @ errors.ravel()
        step = -_factored(weighted @ jacobian).solve(gradient).reshape(-1, 6)
        before, gain = terms.cost(errors, each), 0.0
        # A step is halved so often at most.
        for _ in range(12):
            there = _moved(turns, places, terms.fixed, step)
            off = terms.errors(*there)
            gain = before - terms.cost(off, each)
            if gain >= 0:
                (turns, places), errors = there, off
                break
            step /= 2
        # Metres and radians; and variances that are no gain.
        size, is_gain = np.abs(step).max(), gain > 1e-4
        if tolerance == 1 and (size < 1e-7 or not is_gain):
            break
        if math.isinf(tolerance):
            # Before pairs are weighed apart.
            if is_gain and size > 1e-4:
                continue
            misfits = terms.misfits(errors)
            tolerance = float(misfits[~doubted].max(initial=0.0)) / HALF
        # By which the tolerance falls from step to step.
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
