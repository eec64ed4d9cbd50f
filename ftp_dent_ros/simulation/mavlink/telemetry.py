"""What a simulated autopilot says of its flight, message by message.

It says what it estimates (`estimate`), stamped with its own time since boot.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.mavlink.link import mavlink
from ftp_dent_ros.simulation.world import World

# The world's own way from ENU to NED and from FRD to FLU: a mistake in the conversions of
# `navigation.frames` must not cancel against itself.
_NED_FROM_ENU = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
_FLU_FROM_FRD = Rotation.from_matrix(np.diag([1, -1, -1]))

# Where map's origin is said to be: degrees * 1e7, millimetres; and metres per 1e-7 degrees there.
_ORIGIN = (474_500_000, 85_600_000, 430_000)
_METRES = 0.0111319, 0.0111319 * math.cos(math.radians(47.45))
_NS = 1_000_000_000
# GPS: a fix every 0.2 s, that old when it is told, and as good as a usual one says it is (mm).
_FIX_NS, _FIX_AGE_NS = _NS // 5, 120_000_000
_ACCURACY = (800, 1200)
_READY = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)
_WITHOUT_POSITION = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_CONST_POS_MODE
)
# ArduPilot flies on by its inertial sensors for as long before it says so; seconds.
_SAYS_READY = 7.0


class Telemetry:
    """Messages of one vehicle by their numbers, each for a time since boot in nanoseconds.

    Parameters
    ----------
    world : World
        Where the drone is, and how its autopilot errs.
    boot_ns : int
        ROS time of its boot.
    start_ns : int
        Time since boot from which its faults are counted.
    """

    def __init__(self, world: World, boot_ns: int, start_ns: int) -> None:
        self._world, self._boot_ns, self._start_ns = world, boot_ns, start_ns
        self._ratio = 0.0
        self.messages: dict[int, Callable[[int], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._estimator_status,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync_request,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._position,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._origin,
        }

    def _uptime(self, boot_ns: int) -> float:
        return (boot_ns - self._start_ns) / _NS

    def _estimate(self, boot_ns: int) -> Pose:
        world = self._world
        seconds = world.flight_time(self._boot_ns + boot_ns)
        pose = world.errors.estimated(world.flight, seconds)
        return Pose(pose.rotation, pose.translation + world.faults.drift(self._uptime(boot_ns)))

    def _heartbeat(self, _: int) -> Any:
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED,
            mavlink.COPTER_MODE_GUIDED,
            mavlink.MAV_STATE_ACTIVE,
            3,
        )

    def _system_time(self, boot_ns: int) -> Any:
        unix_us = (self._boot_ns + boot_ns) // 1000
        return mavlink.MAVLink_system_time_message(unix_us, milliseconds(boot_ns))

    def _estimator_status(self, boot_ns: int) -> Any:
        uptime, faults = self._uptime(boot_ns), self._world.faults
        if not faults.is_frozen(uptime):
            # A new one with every fix.
            self._ratio = 0.5 + 0.4 * math.sin(2.4 * (boot_ns // _FIX_NS))
        is_ready = faults.without_gps(uptime) < _SAYS_READY
        # As large as a real one's in good weather.
        ratios = np.array([0.02, 0.01, 0.0006]) * self._ratio
        return mavlink.MAVLink_ekf_status_report_message(
            _READY if is_ready else _WITHOUT_POSITION, *ratios, 0.02, 0.0
        )

    def _timesync_request(self, boot_ns: int) -> Any:
        return mavlink.MAVLink_timesync_message(0, boot_ns)

    def _origin(self, boot_ns: int) -> Any:
        return mavlink.MAVLink_gps_global_origin_message(*_ORIGIN, boot_ns // 1000)

    def _attitude(self, boot_ns: int) -> Any:
        rotation = _NED_FROM_ENU * self._estimate(boot_ns).rotation * _FLU_FROM_FRD
        x, y, z, w = rotation.as_quat()
        flight = self._world.flight
        rates = flight.body_rates(self._world.flight_time(self._boot_ns + boot_ns))
        return mavlink.MAVLink_attitude_quaternion_message(
            milliseconds(boot_ns), w, x, y, z, *_FLU_FROM_FRD.inv().apply(rates)
        )

    def _position(self, boot_ns: int) -> Any:
        return mavlink.MAVLink_local_position_ned_message(
            milliseconds(boot_ns),
            *_NED_FROM_ENU.apply(self._estimate(boot_ns).translation),
            *_NED_FROM_ENU.apply(self._velocity(boot_ns)),
        )

    def _velocity(self, boot_ns: int) -> NDArray[np.float64]:
        world = self._world
        return world.flight.velocity(world.flight_time(self._boot_ns + boot_ns))

    def _global_position(self, boot_ns: int) -> Any:
        place = self._estimate(boot_ns).translation
        velocity = np.rint(100 * _NED_FROM_ENU.apply(self._velocity(boot_ns))).astype(int)
        return mavlink.MAVLink_global_position_int_message(
            milliseconds(boot_ns), *_on_earth(place), round(1e3 * place[2]), *velocity, 65535
        )

    def _gps(self, boot_ns: int) -> Any:
        """The last fix: where the drone truly was."""
        fix_ns = (boot_ns - _FIX_AGE_NS) // _FIX_NS * _FIX_NS
        if self._world.faults.without_gps(self._uptime(boot_ns)):
            return mavlink.MAVLink_gps_raw_int_message(
                0, mavlink.GPS_FIX_TYPE_NO_FIX, 0, 0, 0, 65535, 65535, 65535, 65535, 3
            )
        true = self._world.base_pose(self._boot_ns + fix_ns).translation
        return mavlink.MAVLink_gps_raw_int_message(
            max(0, fix_ns) // 1000,
            mavlink.GPS_FIX_TYPE_3D_FIX,
            *_on_earth(true),
            *(80, 120, 10, 0, 16),
            h_acc=_ACCURACY[0],
            v_acc=_ACCURACY[1],
        )


def milliseconds(boot_ns: int) -> int:
    """``time_boot_ms``, which starts again after 49.7 days."""
    return boot_ns // 1_000_000 % 2**32


def _on_earth(place: NDArray[np.float64]) -> tuple[int, int, int]:
    """Latitude and longitude in 1e-7 degrees and altitude in mm of a place in the map."""
    east, north, up = place
    return (
        _ORIGIN[0] + round(north / _METRES[0]),
        _ORIGIN[1] + round(east / _METRES[1]),
        _ORIGIN[2] + round(1e3 * up),
    )
