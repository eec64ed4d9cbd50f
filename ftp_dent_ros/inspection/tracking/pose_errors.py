"""How far a pose of a flight may be off, and what that does to the places of its dents."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.tracking.moves import about
from ftp_dent_ros.pose import Pose

# Standard uncertainty of a pose whose covariance is not known (all zeros, in ROS): metres,
# radians.
UNKNOWN_POSITION, UNKNOWN_ANGLE = 0.02, 0.01
# Of a pose that nothing is uncertain about: a cloud in its own frame.
EXACT = np.eye(6) * 1e-12
# What no pose is better than: 1 mm, 0.5 mrad.
_NEVER_BETTER = np.diag([1e-3**2] * 3 + [5e-4**2] * 3)


def position_covariance(
    position: NDArray[np.float64],
    pose: Pose | None = None,
    covariance: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Covariance of a point that a pose places, shape (3, 3), square metres."""
    if covariance is None or not np.any(covariance):
        return np.eye(3) * UNKNOWN_POSITION**2
    jacobian = about(position - (0.0 if pose is None else pose.translation))
    return jacobian @ np.asarray(covariance, float).reshape(6, 6) @ jacobian.T


def known_covariance(covariance: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """The covariance of a pose's error, shape (6, 6), also where it was not told."""
    if covariance is None or not np.any(covariance):
        return np.diag([UNKNOWN_POSITION**2] * 3 + [UNKNOWN_ANGLE**2] * 3)
    return np.asarray(covariance, float).reshape(6, 6) + _NEVER_BETTER


def error_of(move: Pose, pivot: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shift of the pivot, and turn about it, of a move: shape (6,)."""
    return np.concatenate([move.apply(pivot) - pivot, move.rotation.as_rotvec()])
