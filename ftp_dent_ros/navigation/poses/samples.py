"""Samples of attitude and position out of the autopilot's messages, in ROS's frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.navigation.poses import accuracy
from ftp_dent_ros.navigation.time_and_place import frames

# A sample of one quantity: its value and its rate of change.
Sample = tuple[NDArray[np.float64], NDArray[np.float64]]

_BODY = mavlink.MAV_FRAME_BODY_FRD


@dataclass(frozen=True)
class Odometry:
    """An ODOMETRY message.

    Attributes
    ----------
    attitude, position : tuple
        As of `attitude` and `position`.
    covariance : ndarray, shape (6, 6), or None
        In the map, if the autopilot says it.
    """

    attitude: Sample
    position: Sample
    covariance: accuracy.Covariance | None


def attitude(message: Any) -> Sample | None:
    """Quaternion (x, y, z, w; FLU -> ENU) and body rates (FLU) of an ATTITUDE_QUATERNION.

    None if it is impossible: not finite, or no rotation.
    """
    quaternion = (message.q1, message.q2, message.q3, message.q4)
    return _attitude(quaternion, (message.rollspeed, message.pitchspeed, message.yawspeed))


def position(message: Any) -> Sample | None:
    """Position and velocity in ENU of a LOCAL_POSITION_NED; None if it is not finite."""
    place, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
    if not all(map(math.isfinite, (*place, *velocity))):
        return None
    return frames.enu_from_ned(place), frames.enu_from_ned(velocity)


def odometry(message: Any) -> Odometry | None:
    """Sample of an ODOMETRY; None if it is impossible, or not in a frame that knows north."""
    rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
    turn, place = _attitude(message.q, rates), position(message)
    if message.frame_id != mavlink.MAV_FRAME_LOCAL_NED or turn is None or place is None:
        return None
    if message.child_frame_id == _BODY:
        velocity = (message.vx, message.vy, message.vz)
        place = place[0], Rotation.from_quat(turn[0]).apply(frames.flu_from_frd(velocity))
    elif message.child_frame_id != mavlink.MAV_FRAME_LOCAL_NED:
        return None
    return Odometry(turn, place, accuracy.of_odometry(message.pose_covariance))


def _attitude(quaternion: Any, rates: Any) -> Sample | None:
    is_finite = all(map(math.isfinite, (*quaternion, *rates)))
    if not is_finite or abs(math.hypot(*quaternion) - 1) > 0.01:
        return None
    return frames.enu_attitude(quaternion), frames.flu_from_frd(rates)
