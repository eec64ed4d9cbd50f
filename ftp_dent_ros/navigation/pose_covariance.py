"""How good a pose is: the covariance of a tag and what it is made of.

==============  =============================================================================
the estimator   ODOMETRY's own covariance where there is one; else of the report of its state:
                ESTIMATOR_STATUS gives the position's in metres. EKF_STATUS_REPORT gives test
                ratios, innovation by (gate times standard deviation): times ArduPilot's default
                gate and noise they are innovations again. Neither is better than a floor.
GPS             what it has become worse by, and how far the estimate is from it where its own
                noise is no excuse: `gps`
the barometer   a scale: its height comes from a pressure by way of a temperature, taken to be the
                sensor's or the standard one. Some 12 K off, of 288, is 4 % of the height
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
from ftp_dent_ros.rigid import about

Covariance = NDArray[np.float64]

# Standard deviation of a rotation of which nothing is known, radians.
_UNKNOWN_ROTATION = 1.0
# The best that an autopilot with GPS, barometer and compass is believed to do: metres across and
# up as a hovering one was measured to wander, radians.
_FLOOR_ACROSS, _FLOOR_UP = 0.03, 0.05
_FLOOR_TILT, _FLOOR_YAW = math.radians(0.5), math.radians(1.0)
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
    is_of_sample : bool
        Whether stamps are those of the samples, as ODOMETRY's are.
    covariance : ndarray, shape (6, 6), or None
        The pose's own, where ODOMETRY brings it.
    """

    velocity: NDArray[np.float64]
    turn_rate: NDArray[np.float64]
    gap: float
    is_of_sample: bool = False
    covariance: Covariance | None = None


def diagonal(position: tuple[float, float, float], rotation: tuple[float, float, float]) -> Any:
    """Covariance of independent standard deviations, metres and radians."""
    return np.diag(np.square([*position, *rotation]))


def reported(message: Any) -> Covariance | None:
    """Covariance of an EKF_STATUS_REPORT or ESTIMATOR_STATUS; None if it says nothing possible."""
    if message.get_type() == 'EKF_STATUS_REPORT':
        horizontal = _HORIZONTAL * message.pos_horiz_variance
        vertical = _VERTICAL * message.pos_vert_variance
        yaw = _YAW * message.compass_variance
    else:
        horizontal, vertical = message.pos_horiz_accuracy, message.pos_vert_accuracy
        # Without a compass there is no ratio, and nothing known of the yaw.
        yaw = _UNKNOWN_ROTATION if math.isnan(message.mag_ratio) else _YAW * message.mag_ratio
    if not all(math.isfinite(value) and value >= 0 for value in (horizontal, vertical, yaw)):
        return None
    across, up = math.hypot(_FLOOR_ACROSS, horizontal), math.hypot(_FLOOR_UP, vertical)
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
    reported: Covariance, motion: Motion, clock_uncertainty: float, height_uncertainty: float = 0.0
) -> Covariance:
    """Covariance of a pose.

    Parameters
    ----------
    reported : ndarray, shape (6, 6)
        By the state of the estimator, where ODOMETRY brings none of its own.
    motion : Motion
    clock_uncertainty : float
        Half the width of the clock's bounds, seconds.
    height_uncertainty : float
        What the barometer's scale makes of the height, metres.
    """
    estimate = reported if motion.covariance is None else motion.covariance
    along = np.concatenate([motion.velocity, motion.turn_rate])
    covariance = estimate + np.outer(along, along) * clock_uncertainty**2 / 3
    if not motion.is_of_sample:
        for part, age in ((slice(0, 3), _AGE_OF_POSITION), (slice(3, 6), _AGE_OF_ATTITUDE)):
            covariance[part, part] += np.outer(along[part], along[part]) * age**2
    covariance[2, 2] += height_uncertainty**2
    bow = motion.gap**2 / 8
    return covariance + diagonal(3 * (_ACCELERATION * bow,), 3 * (_TURN_ACCELERATION * bow,))


def of_mounted(
    covariance: Covariance, pose: Pose, mount: Pose, mount_covariance: Covariance
) -> Covariance:
    """Covariance of what is mounted on a vehicle, at ``pose @ mount``.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
        Of the vehicle's pose in the map.
    pose, mount : Pose
        Of the vehicle in the map, and of what it carries on the vehicle.
    mount_covariance : ndarray, shape (6, 6)
        Of the mount, in the vehicle's axes: of its place and of its rotation.
    """
    carried = np.eye(6)
    carried[:3] = about(pose.rotation.apply(mount.translation))
    turned = np.kron(np.eye(2), pose.rotation.as_matrix())
    result: Covariance = carried @ covariance @ carried.T + turned @ mount_covariance @ turned.T
    return result
