"""How good a pose is: the covariance of a tag and what it is made of.

==============  =============================================================================
the estimator   ODOMETRY's own covariance where there is one; else of the report of its state:
                ESTIMATOR_STATUS gives the position's in metres. EKF_STATUS_REPORT gives test
                ratios, innovation by (gate times standard deviation): times ArduPilot's default
                gate and noise they are innovations again. Neither is better than a floor.
the clock       its uncertainty, half the width of the proven bounds (uniform: by sqrt 3), times
                velocity and turn rate, fully correlated
the stamps      of ATTITUDE_QUATERNION and LOCAL_POSITION_NED are when they were put together,
                not when it was so; ODOMETRY's are of the sample
interpolation   the curvature between two samples, of a rough flight, across their gap
the mount       the camera's place on the vehicle, as well as it was measured: a parameter
==============  =============================================================================

A covariance is of shape (6, 6): position in the map in metres, then rotation about the map's fixed
axes in radians, as in geometry_msgs/PoseWithCovariance. Its parts add up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.navigation import frames
from ftp_dent_ros.pose import Pose

Covariance = NDArray[np.float64]

# Standard deviations of what nothing is known of: metres, radians.
_UNKNOWN_POSITION, _UNKNOWN_ROTATION = 10.0, 1.0
# The best that an autopilot with GPS and compass is believed to do.
_FLOOR_POSITION, _FLOOR_TILT, _FLOOR_YAW = 0.03, math.radians(0.5), math.radians(1.0)
# ArduPilot's defaults, gate times noise: EK3_POS_I_GATE 5, EK3_POSNE_M_NSE 0.5 m;
# EK3_HGT_I_GATE 5, EK3_ALT_M_NSE 2 m; EK3_MAG_I_GATE 3, EK3_MAG_M_NSE 0.05 gauss of some 0.22.
_HORIZONTAL, _VERTICAL, _YAW = 2.5, 10.0, 0.7
# How old what a stamped message says may be, seconds: measured on ArduCopter.
_AGE_OF_POSITION, _AGE_OF_ATTITUDE = 0.02, 0.005
# A rough flight between two samples, one standard deviation: m/s2 and rad/s2.
_ACCELERATION, _TURN_ACCELERATION = 3.0, 3.0


@dataclass(frozen=True)
class Tag:
    """A pose of `base_link` in `map` and its covariance, of shape (6, 6).

    `boot` is the autopilot's time since boot, nanoseconds.
    """

    pose: Pose
    covariance: Covariance
    boot: int


@dataclass(frozen=True)
class Motion:
    """How a vehicle moved at a moment.

    Attributes
    ----------
    velocity : ndarray, shape (3,)
        In the map, m/s.
    turn_rate : ndarray, shape (3,)
        About the map's axes, rad/s.
    gap : float
        Time between the samples around the moment, seconds; 0 at a sample.
    """

    velocity: NDArray[np.float64]
    turn_rate: NDArray[np.float64]
    gap: float


def diagonal(position: tuple[float, float, float], rotation: tuple[float, float, float]) -> Any:
    """Covariance of independent standard deviations, metres and radians."""
    return np.diag(np.square([*position, *rotation]))


def unknown() -> Covariance:
    """Covariance where the autopilot says nothing of its accuracy."""
    return diagonal(3 * (_UNKNOWN_POSITION,), 3 * (_UNKNOWN_ROTATION,))


def reported(message: Any) -> Covariance:
    """Covariance of an EKF_STATUS_REPORT or ESTIMATOR_STATUS."""
    if message.get_type() == 'EKF_STATUS_REPORT':
        horizontal = _HORIZONTAL * message.pos_horiz_variance
        vertical = _VERTICAL * message.pos_vert_variance
        yaw = _YAW * message.compass_variance
    else:
        horizontal, vertical = message.pos_horiz_accuracy, message.pos_vert_accuracy
        yaw = _YAW * message.mag_ratio
    if not all(math.isfinite(value) and value >= 0 for value in (horizontal, vertical, yaw)):
        return unknown()
    across, up = math.hypot(_FLOOR_POSITION, horizontal), math.hypot(_FLOOR_POSITION, vertical)
    about_up = math.hypot(_FLOOR_YAW, yaw)
    return diagonal((across, across, up), (_FLOOR_TILT, _FLOOR_TILT, about_up))


def of_odometry(upper_triangle: Any) -> Covariance | None:
    """Covariance of an ODOMETRY in NED, or None if it does not say it.

    PX4 fills the diagonal alone and leaves the rest NaN: no correlation is known.
    """
    ned = np.zeros((6, 6))
    ned[np.triu_indices(6)] = upper_triangle
    variances = np.diag(ned).copy()
    if not (np.isfinite(variances).all() and (variances > 0).all()):
        return None
    ned = np.nan_to_num(ned, nan=0.0, posinf=0.0, neginf=0.0)
    ned = ned + ned.T - np.diag(variances)
    if np.linalg.eigvalsh(ned).min() < 0:
        ned = np.diag(variances)
    to_enu = np.kron(np.eye(2), frames.enu_from_ned(np.eye(3)).T)
    covariance: Covariance = to_enu @ ned @ to_enu.T
    return covariance


def of_tag(
    estimate: Covariance, motion: Motion, clock_uncertainty: float, is_of_sample: bool
) -> Covariance:
    """Covariance of a pose.

    Parameters
    ----------
    estimate : ndarray, shape (6, 6)
        The estimator's own.
    motion : Motion
    clock_uncertainty : float
        Half the width of the clock's bounds, seconds.
    is_of_sample : bool
        Whether stamps are those of the samples, as ODOMETRY's are.
    """
    along = np.concatenate([motion.velocity, motion.turn_rate])
    covariance = estimate + np.outer(along, along) * clock_uncertainty**2 / 3
    if not is_of_sample:
        for part, age in ((slice(0, 3), _AGE_OF_POSITION), (slice(3, 6), _AGE_OF_ATTITUDE)):
            covariance[part, part] += np.outer(along[part], along[part]) * age**2
    bow = motion.gap**2 / 8
    return covariance + diagonal(3 * (_ACCELERATION * bow,), 3 * (_TURN_ACCELERATION * bow,))


def of_mount(translation: float, rotation: float) -> Covariance:
    """What a camera's mount adds, known to within metres and radians in every direction."""
    return diagonal(3 * (translation,), 3 * (rotation,))
