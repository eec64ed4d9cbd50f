"""All poses of a survey at once: by what pairs of clouds tell, and what the autopilot says."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from ftp_dent_ros.inspection.tracking.moves import about
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.normal_equations import NormalEquations
from ftp_dent_ros.survey.relative_pose import RelativePose
from ftp_dent_ros.survey.stated_poses import ANCHOR, Node, add_stated, relative_doubt

# Of squared errors by directions told: where a pair counts half, and from where on not at all.
_HALF, _WRONG = 16.0, 36.0
_STEPS, _DONE, _COARSE = 30, 1e-8, 1e-4
# By which the tolerance falls from step to step: H. Yang et al., IEEE RA-L 5, 1127 (2020).
_GRADUAL = 4.0
# Columns of the inverse that are solved for at once.
_AT_ONCE = 600


@dataclass(frozen=True, eq=False)
class Link:
    """A relative pose between two clouds, the second's seen from the first."""

    first: int
    second: int
    relative: RelativePose


class PoseGraph:
    """Poses of cameras, and what joins them; all that is told is relative or the autopilot's."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.poses: list[Pose] = []
        self.guesses: list[Pose] = []
        self.links: list[Link] = []
        self.left_out: set[int] = set()

    def add(self, node: Node, guess: Pose) -> None:
        """Another pose, about where it is guessed to be."""
        self.nodes.append(node)
        self.poses.append(guess)
        self.guesses.append(guess)

    def link(self, first: int, second: int, relative: RelativePose) -> None:
        """Another relative pose."""
        self.links.append(Link(first, second, relative))

    def tail(self, count: int) -> PoseGraph:
        """The last poses and what joins them, without what was before."""
        start = max(0, len(self.nodes) - count)
        last = PoseGraph()
        for node, pose in zip(self.nodes[start:], self.poses[start:], strict=True):
            last.add(node, pose)
        for link in reversed(self.links):
            if link.second < start:
                break
            if link.first >= start:
                last.link(link.first - start, link.second - start, link.relative)
        return last

    def solve(self, fixed: int = 0) -> None:
        """Move the poses from number `fixed` on to where they agree best."""
        weights: dict[int, float] = {}
        tolerance = math.inf
        for _ in range(_STEPS):
            matrix, gradient = self._normal(fixed, weights)
            if not len(gradient):
                return
            step = -splu(matrix).solve(gradient).reshape(-1, 6)
            for index, each in enumerate(step, start=fixed):
                pose = self.poses[index]
                self.poses[index] = Pose(
                    Rotation.from_rotvec(each[3:]) * pose.rotation, pose.translation + each[:3]
                )
            misfits = [self._misfit(link) for _, link in self._links(fixed)]
            settled = tolerance == 1 and np.abs(step).max() < _DONE
            if settled:
                break
            # Graduated: first the whole falls into place, then who contradicts is heard less.
            if math.isinf(tolerance):
                if np.abs(step).max() > _COARSE:
                    continue
                tolerance = max(misfits, default=0.0) / _HALF
            tolerance = max(1.0, tolerance / _GRADUAL)
            weights = self._weights(fixed, tolerance)
        judged = {index: self._misfit(link) for index, link in self._links(fixed)}
        wrong = {index for index, misfit in judged.items() if misfit > _WRONG}
        self.left_out = (self.left_out - judged.keys()) | wrong

    def covariances(self, anchor: int | None = None) -> NDArray[np.float64]:
        """Covariance of every pose, shape (n, 6, 6), as in geometry_msgs/PoseWithCovariance.

        Parameters
        ----------
        anchor : int, optional
            The pose that is taken for exact; that of the map by default.
        """
        matrix, _ = self._normal(0, self._weights(0), anchor)
        solver, size = splu(matrix), matrix.shape[0]
        blocks = np.empty((size // 6, 6, 6))
        for start in range(0, size, _AT_ONCE):
            stop = min(start + _AT_ONCE, size)
            unit = np.zeros((size, stop - start))
            unit[np.arange(start, stop), np.arange(stop - start)] = 1
            columns = solver.solve(unit)
            for index in range(start // 6, stop // 6):
                rows = slice(6 * index, 6 * index + 6)
                block = columns[rows, 6 * index - start : 6 * index + 6 - start]
                blocks[index] = (block + block.T) / 2
        return blocks

    def groups(self) -> list[int]:
        """Number of the group that each pose belongs to: those that links join."""
        joins = [
            (link.first, link.second)
            for index, link in self._links(0)
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

    def _links(self, fixed: int) -> Iterable[tuple[int, Link]]:
        for index, link in enumerate(self.links):
            if link.relative.told and max(link.first, link.second) >= fixed:
                yield index, link

    def _error(self, link: Link) -> NDArray[np.float64]:
        seen = self.poses[link.first].inverse() @ self.poses[link.second]
        return link.relative.error(seen)

    def _misfit(self, link: Link) -> float:
        error = self._error(link)
        return float(error @ link.relative.information @ error) / link.relative.told

    def _weights(self, fixed: int, tolerance: float = 1.0) -> dict[int, float]:
        return {
            index: _weight(self._misfit(link) / tolerance) for index, link in self._links(fixed)
        }

    def _normal(
        self, fixed: int, weights: dict[int, float], anchor: int | None = None
    ) -> tuple[csc_matrix, NDArray[np.float64]]:
        """Normal equations of the poses from `fixed` on: matrix and gradient."""
        equations = NormalEquations(fixed, len(self.nodes) - fixed)
        for index, link in self._links(fixed):
            self._add_link(equations, link, weights.get(index, 1.0))
        if anchor is not None:
            equations.add([anchor], [np.eye(6)], np.zeros(6), np.linalg.inv(ANCHOR))
        add_stated(equations, self.nodes, self.poses, self.guesses, anchor)
        return equations.matrix(), equations.gradient

    def _add_link(self, equations: NormalEquations, link: Link, weight: float) -> None:
        a, b = self.poses[link.first], self.poses[link.second]
        place = a.apply(link.relative.centre)
        back = np.kron(np.eye(2), a.rotation.as_matrix().T)
        moves = []
        for pose in (a, b):
            move = np.eye(6)
            move[:3] = about(place - pose.translation)
            moves.append(back @ move)
        equations.add(
            [link.first, link.second],
            [-moves[0], moves[1]],
            self._error(link),
            weight * link.relative.information,
        )


def _weight(misfit: float) -> float:
    """Of a pair by its squared error a direction: of Geman and McClure's robust least squares."""
    return 1 / (1 + misfit / _HALF) ** 2
