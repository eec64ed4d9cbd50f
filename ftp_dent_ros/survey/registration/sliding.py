"""What a shape tells of two patches where nothing tells how far they are slid along each other.

Least squares on heights is sure to a micrometre even where one patch is laid beside its place, on
other dents and other waves. So both are slid as far as is in doubt, laid on each other there, and
what comes out otherwise is added to what is in doubt.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.registration.information import Told
from ftp_dent_ros.survey.registration.relative_pose import UnlikePairError
from ftp_dent_ros.survey.registration.twists import motions, twists

Array = NDArray[np.float64]

# Metres that a turn of a radian is taken for: half of a patch.
_ARM = 0.15
_SCALE = np.array([1, 1, 1, 1 / _ARM, 1 / _ARM, 1 / _ARM])
# By how much a patch that is slid may slide on while it is laid on the other, metres.
_HELD = 1e-5


def slid_information(
    told: Told,
    pose: Pose,
    centre: Array,
    doubt: Array,
    laid: Callable[[Pose, Array], Pose],
) -> Array:
    """Information on a pose by shape, shape (6, 6), wherever within its doubt the patches lie.

    Parameters
    ----------
    told : Told
        At the pose.
    doubt : ndarray, shape (6, 6)
        Covariance of the guess, of the shift of the centre and the turn.
    laid : callable
        Lays the patches on each other by their heights, from a pose on, held by a matrix.
    """
    if told.count in (0, 6):
        return told.information
    both = np.outer(_SCALE, _SCALE)
    values, directions = np.linalg.eigh(told.information * both)
    free, sure = directions[:, : 6 - told.count], directions[:, 6 - told.count :]
    spread = np.linalg.inv(np.linalg.inv(doubt) * both + told.information * both)
    variances, ways = np.linalg.eigh(free.T @ spread @ free)
    held = free @ free.T / both / _HELD**2
    covariance = np.diag(1 / values[6 - told.count :])
    for step in (free @ ways * np.sqrt(variances)).T:
        for sign in (1, -1):
            try:
                other = laid(_moved(pose, sign * (step * _SCALE), centre), held)
            except UnlikePairError:
                continue
            off = other @ pose.inverse()
            twist = twists(off.rotation.as_matrix(), off.apply(centre) - centre)
            change = sure.T @ (twist / _SCALE)
            covariance += np.outer(change, change) / 2
    return sure @ np.linalg.inv(covariance) @ sure.T / both


def _moved(pose: Pose, twist: Array, centre: Array) -> Pose:
    """A pose after a shift and a turn about a centre, shape (6,)."""
    turn, shift = (each[0] for each in motions(twist[None]))
    rotation = Rotation.from_matrix(turn)
    return Pose(rotation, centre + shift - rotation.apply(centre)) @ pose
