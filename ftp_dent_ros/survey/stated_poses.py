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
from ftp_dent_ros.survey.normal_equations import NormalEquations

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


def add_stated(
    equations: NormalEquations,
    nodes: Sequence[Node],
    poses: Sequence[Pose],
    guesses: Sequence[Pose],
    anchor: int | None = None,
) -> None:
    """Add what the autopilot says: of the first, and of each how it differs from the last.

    Parameters
    ----------
    equations : NormalEquations
    nodes : sequence of Node
    poses : sequence of Pose
        As they are found so far.
    guesses : sequence of Pose
        About which those that nothing is said of lie.
    anchor : int, optional
        The pose that is taken for exact; that of the map by default.
    """
    last: tuple[int, Node, Pose] | None = None
    for index, node in enumerate(nodes):
        stated, covariance = node.stated, node.covariance
        moves = index >= equations.fixed
        if stated is None or covariance is None:
            if moves:
                spread = ANCHOR if index == 0 and anchor is None else _UNTOLD
                error = _off(poses[index], guesses[index])
                equations.add([index], [np.eye(6)], error, np.linalg.inv(spread))
            continue
        if moves and (last is None or last[1].flight != node.flight):
            error = _off(poses[index], stated)
            if anchor is None:
                equations.add([index], [np.eye(6)], error, np.linalg.inv(covariance))
            elif nodes[anchor].flight != node.flight:
                # Of two flights' errors, neither is known.
                equations.add([index], [np.eye(6)], error, np.linalg.inv(2 * covariance))
        elif moves and last is not None:
            before, earlier, there = last
            keep = _kept(earlier, node)
            spread = (1 - keep**2) * covariance + 2 * _JITTER
            if anchor is not None:
                # Seen from a pose that errs itself, errors differ ever more.
                spread, keep = 2 * (1 - keep) * covariance + 2 * _JITTER, 1.0
            difference = _off(poses[index], stated) - keep * _off(poses[before], there)
            each = [-keep * np.eye(6), np.eye(6)]
            equations.add([before, index], each, difference, np.linalg.inv(spread))
        last = index, node, stated


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
    keep = _kept(a, b)
    spread = (a.covariance + b.covariance) * (1 - keep) + 2 * _JITTER
    # The first one's turn moves what lies at the end of the arm.
    carried = np.zeros((6, 6))
    carried[:3, 3:] = about(second.translation - first.translation)[:, 3:]
    spread = spread + carried @ (a.covariance * (1 - keep) + _JITTER) @ carried.T
    turn = np.kron(np.eye(2), first.rotation.as_matrix())
    return turn.T @ spread @ turn


def _kept(earlier: Node, later: Node) -> float:
    """Share of an autopilot's error that is still there."""
    if earlier.flight != later.flight:
        return 0.0
    return math.exp(-abs(later.seconds - earlier.seconds) / _FORGOTTEN)


def _off(pose: Pose, stated: Pose) -> NDArray[np.float64]:
    """Shift and turn from what is said to what is found, shape (6,)."""
    turn = (pose.rotation * stated.rotation.inv()).as_rotvec()
    return np.concatenate([pose.translation - stated.translation, turn])
