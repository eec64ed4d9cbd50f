"""Whether the autopilot's estimate may be believed at a moment, and how far.

Put together from what the estimator says of itself, what GPS says, and how far the two are apart;
a range finder that looks down is shown beside them (the ground need not be level). VFR_HUD is not
asked for: both autopilots fill it from the same estimate.
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.autopilot.streams import Stream
from ftp_dent_ros.navigation.autopilot.vehicle_state import Instant, Settings
from ftp_dent_ros.navigation.poses import accuracy
from ftp_dent_ros.navigation.poses.accuracy import Covariance
from ftp_dent_ros.navigation.poses.estimator import FROZEN, REPORTS, Estimator
from ftp_dent_ros.navigation.poses.gps import Gps

# As often as GPS gives a fix.
_RATE, _RANGE_RATE = 5.0, 2.0
_DOWN = mavlink.MAV_SENSOR_ROTATION_PITCH_270


class Trust:
    """Follows one autopilot; times are ROS times of arrival in nanoseconds."""

    def __init__(self, settings: Settings) -> None:
        self._estimator = Estimator()
        self._gps = Gps() if settings.position_source == 'gps' else None
        self._ground: float | None = None
        self.handlers = {
            **dict.fromkeys(REPORTS, self._on_report),
            'GPS_RAW_INT': self._on_gps_raw_int,
            'GLOBAL_POSITION_INT': self._on_global_position_int,
            'DISTANCE_SENSOR': self._on_distance_sensor,
        }

    def streams(self, autopilot: int) -> list[Stream]:
        """The messages that are wanted of an autopilot (a MAV_AUTOPILOT)."""
        is_ardupilot = autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        report = 'EKF_STATUS_REPORT' if is_ardupilot else 'ESTIMATOR_STATUS'
        wanted = {report: _RATE, 'DISTANCE_SENSOR': _RANGE_RATE}
        if self._gps is not None:
            wanted |= {'GPS_RAW_INT': _RATE, 'GLOBAL_POSITION_INT': _RATE}
        return [Stream(name, rate, required=False) for name, rate in wanted.items()]

    def restart(self, now: int) -> None:
        """Forget all: the autopilot has just been found, or has rebooted."""
        self._estimator.restart(now)
        self._ground = None
        if self._gps is not None:
            self._gps.restart(now)

    def check(self, stamp: int, heard: int) -> tuple[Covariance, Covariance]:
        """Covariances of shape (6, 6) of the estimate at a stamp.

        Parameters
        ----------
        stamp : int
        heard : int
            When the autopilot was last heard at all.

        Returns
        -------
        tuple of ndarray
            What the estimator tells, where ODOMETRY does not bring its own, and what GPS adds to
            either.

        Raises
        ------
        PoseAwaitedError
            A report is needed that is still to come.
        PoseError
            The estimate is not to be believed at that time.
        """
        try:
            estimate = self._estimator.check(stamp, heard)
        except PoseError as error:
            if error.reason == FROZEN and self._gps is not None:
                self._gps.check(stamp, heard)  # Rather the cause than what comes of it.
            raise
        across, up = (0.0, 0.0) if self._gps is None else self._gps.check(stamp, heard)
        return estimate, accuracy.diagonal((across, across, up), (0.0, 0.0, 0.0))

    def is_good(self, now: int) -> bool:
        """Whether nothing speaks against the estimate of this moment."""
        gps = None if self._gps is None else self._gps.state(now)
        is_fixed = gps is None or (not gps.fault and gps.age is not None)
        return is_fixed and self._estimator.state(now) == 'ready'

    def state(self, now: int) -> dict[str, Any]:
        """What `VehicleState` holds of it, at a ROS time."""
        return {
            'estimator': self._estimator.state(now),
            'estimator_fault': self._estimator.fault(),
            'gps': None if self._gps is None else self._gps.state(now),
            'above_ground': self._ground,
        }

    def _on_report(self, message: Any, at: Instant) -> None:
        self._estimator.report(message, at.ros)

    def _on_gps_raw_int(self, message: Any, at: Instant) -> None:
        if self._gps is not None:
            self._gps.on_gps_raw_int(message, at.ros)

    def _on_global_position_int(self, message: Any, at: Instant) -> None:
        if self._gps is not None:
            self._gps.on_global_position_int(message, at.ros)

    def _on_distance_sensor(self, message: Any, at: Instant) -> None:
        distance = message.current_distance
        if message.orientation == _DOWN:
            is_within = message.min_distance < distance < message.max_distance
            self._ground = 0.01 * distance if is_within and math.isfinite(distance) else None
