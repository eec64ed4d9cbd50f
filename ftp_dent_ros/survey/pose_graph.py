"""All poses of a survey at once: by what pairs of clouds tell, and by what the autopilot says.

The autopilot's error wanders: it is nearly the same at neighbouring clouds, and forgotten after
some seconds. So its poses hold the survey in the map as one, and neighbours to each other, but
many of them do not average their common error away. That is an Ornstein-Uhlenbeck process, whose
terms join neighbours only, so that the equations stay sparse.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.relative_pose import RelativePose

# After which an autopilot's error is another one, seconds: the shortest that hovering ones were
# seen to have; a longer one would believe more of it.
FORGOTTEN = 5.0
# What an autopilot errs anew each time, metres and radians.
_JITTER = np.diag([3e-3**2] * 3 + [1e-3**2] * 3)
# Where nothing says where the survey lies: metres, radians.
_ANCHOR = np.eye(6) * 1e-12
# About its guess, of a pose that nothing may tell: metres, radians.
_UNTOLD = np.diag([0.5**2] * 3 + [0.3**2] * 3)
# Of squared errors by directions told: where a pair counts half, and from where on not at all.
_HALF, _WRONG = 16.0, 36.0
_STEPS, _DONE, _COARSE = 30, 1e-8, 1e-4
# By which the tolerance falls from step to step: H. Yang et al., IEEE RA-L 5, 1127 (2020).
_GRADUAL = 4.0
# Columns of the inverse that are solved for at once.
_AT_ONCE = 600


@dataclass(frozen=True, eq=False)
class Node:
    """A cloud's pose: what the autopilot says of the camera, if anything, and when."""

    stated: Pose | None
    covariance: NDArray[np.float64] | None
    seconds: float
    flight: int


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
        group = list(range(len(self.nodes)))

        def root(index: int) -> int:
            while group[index] != index:
                group[index] = group[group[index]]
                index = group[index]
            return index

        for index, link in self._links(0):
            if index not in self.left_out and link.relative.told == 6:
                group[root(link.second)] = root(link.first)
        return [root(index) for index in range(len(group))]

    def relative_doubt(self, first: int, second: int) -> NDArray[np.float64]:
        """Covariance of the second camera's place seen from the first, by the autopilot alone.

        Along the first camera's axes, about the second camera.
        """
        a, b = self.nodes[first], self.nodes[second]
        if a.covariance is None or b.covariance is None:
            raise ValueError('the poses of two clouds are not stated')
        keep = _kept(a, b)
        spread = (a.covariance + b.covariance) * (1 - keep) + 2 * _JITTER
        # The first one's turn moves what lies at the end of the arm.
        arm = self.poses[second].translation - self.poses[first].translation
        carried = np.zeros((6, 6))
        carried[:3, 3:] = _crossed(arm)
        spread = spread + carried @ (a.covariance * (1 - keep) + _JITTER) @ carried.T
        turn = np.kron(np.eye(2), self.poses[first].rotation.as_matrix())
        return turn.T @ spread @ turn

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
        count = len(self.nodes) - fixed
        sums = _Sums(fixed, count)
        for index, link in self._links(fixed):
            self._add_link(sums, link, weights.get(index, 1.0))
        if anchor is None:
            self._add_stated(sums, fixed)
        else:
            sums.add([anchor], [np.eye(6)], np.zeros(6), np.linalg.inv(_ANCHOR))
            self._add_stated(sums, fixed, anchor)
        return sums.matrix(), sums.gradient

    def _add_link(self, sums: _Sums, link: Link, weight: float) -> None:
        a, b = self.poses[link.first], self.poses[link.second]
        place = a.apply(link.relative.centre)
        back = np.kron(np.eye(2), a.rotation.as_matrix().T)
        moves = []
        for pose in (a, b):
            move = np.eye(6)
            move[:3, 3:] = -_crossed(place - pose.translation)
            moves.append(back @ move)
        sums.add(
            [link.first, link.second],
            [-moves[0], moves[1]],
            self._error(link),
            weight * link.relative.information,
        )

    def _add_stated(self, sums: _Sums, fixed: int, anchor: int | None = None) -> None:
        """What the autopilot says: of the first, and of each how it differs from the last."""
        before: int | None = None
        for index, node in enumerate(self.nodes):
            if node.stated is None or node.covariance is None:
                if index >= fixed:
                    first = index == 0 and anchor is None
                    spread = _ANCHOR if first else _UNTOLD
                    error = self._off(index, self.guesses[index])
                    sums.add([index], [np.eye(6)], error, np.linalg.inv(spread))
                continue
            if index >= fixed:
                error = self._off(index, node.stated)
                earlier = None if before is None else self.nodes[before]
                if (
                    before is None
                    or earlier is None
                    or earlier.stated is None
                    or earlier.flight != node.flight
                ):
                    spread = node.covariance
                    if anchor is not None:
                        if self.nodes[anchor].flight == node.flight:
                            before = index
                            continue
                        # Of two flights' errors, neither is known.
                        spread = 2 * spread
                    sums.add([index], [np.eye(6)], error, np.linalg.inv(spread))
                else:
                    keep = _kept(earlier, node)
                    spread = (1 - keep**2) * node.covariance + 2 * _JITTER
                    if anchor is not None:
                        # Seen from a pose that errs itself, errors differ ever more.
                        spread, keep = 2 * (1 - keep) * node.covariance + 2 * _JITTER, 1.0
                    difference = error - keep * self._off(before, earlier.stated)
                    sums.add(
                        [before, index],
                        [-keep * np.eye(6), np.eye(6)],
                        difference,
                        np.linalg.inv(spread),
                    )
            before = index

    def _off(self, index: int, stated: Pose) -> NDArray[np.float64]:
        pose = self.poses[index]
        turn = (pose.rotation * stated.rotation.inv()).as_rotvec()
        return np.concatenate([pose.translation - stated.translation, turn])


class _Sums:
    """Normal equations, block by block; poses before the first are fixed."""

    def __init__(self, fixed: int, count: int) -> None:
        self._fixed, self._count = fixed, count
        self.gradient = np.zeros(6 * count)
        self._blocks: dict[tuple[int, int], NDArray[np.float64]] = {}

    def add(
        self,
        poses: list[int],
        moves: list[NDArray[np.float64]],
        error: NDArray[np.float64],
        information: NDArray[np.floating],
    ) -> None:
        free = [
            (p - self._fixed, m) for p, m in zip(poses, moves, strict=True) if p >= self._fixed
        ]
        for i, move in free:
            held = move.T @ information
            self.gradient[6 * i : 6 * i + 6] += held @ error
            for j, other in free:
                block = held @ other
                known = self._blocks.get((i, j))
                self._blocks[i, j] = block if known is None else known + block

    def matrix(self) -> csc_matrix:
        size = 6 * self._count
        if not self._blocks:
            return csc_matrix((size, size))
        places = np.array(list(self._blocks))
        values = np.stack(list(self._blocks.values()))
        inside = np.arange(6)
        rows = np.broadcast_to(6 * places[:, 0, None, None] + inside[:, None], values.shape)
        columns = np.broadcast_to(6 * places[:, 1, None, None] + inside, values.shape)
        entries = (values.ravel(), (rows.ravel(), columns.ravel()))
        return coo_matrix(entries, shape=(size, size)).tocsc()


def _weight(misfit: float) -> float:
    """Of a pair by its squared error a direction: of Geman and McClure's robust least squares."""
    return 1 / (1 + misfit / _HALF) ** 2


def _kept(earlier: Node, later: Node) -> float:
    """Share of an autopilot's error that is still there."""
    if earlier.flight != later.flight:
        return 0.0
    return math.exp(-abs(later.seconds - earlier.seconds) / FORGOTTEN)


def _crossed(arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix of the cross product of an arm with a vector."""
    x, y, z = arm
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
