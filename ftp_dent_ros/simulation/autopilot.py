"""A simulated autopilot: its messages, its link, and the program."""

from __future__ import annotations

import argparse
import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import ConfigurationError, FtpDentError, LinkError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.world import World, read_world
from ftp_dent_ros.supervision.processes import ignore_signals

_ADDRESS = re.compile(r'udp(in|out):[\w.-]+:(\d{1,5})')

# The world's own way from ENU to NED and from FRD to FLU: a mistake in the conversions of
# `navigation.frames` must not cancel against itself.
_NED_FROM_ENU = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
_FLU_FROM_FRD = Rotation.from_matrix(np.diag([1, -1, -1]))

# Where map's origin is said to be: degrees * 1e7, millimetres; and metres per 1e-7 degrees there.
_ORIGIN = (474_500_000, 85_600_000, 430_000)
_METRES = 0.0111319, 0.0111319 * math.cos(math.radians(47.45))
_NS = 1_000_000_000
# GPS: a fix every 0.2 s, that old when it is sent, and as good as a usual one says it is (mm).
_FIX_NS, _FIX_AGE_NS = _NS // 5, 120_000_000
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

_SECOND_US = 1_000_000
# Microseconds between two messages of a kind: 250 a second, one an hour.
_SHORTEST_US, _LONGEST_US = 4_000, 3_600 * _SECOND_US
# How late a message may be.
_HOPELESS_NS = _NS // 2
_DEFAULTS_US = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _SECOND_US,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _SECOND_US,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0,
}


os.environ.setdefault('MAVLINK20', '1')


def open_link(address: str) -> Any:
    """A connection of pymavlink that speaks as component 1 of system 1.

    Raises
    ------
    ConfigurationError
        The address is of neither kind.
    LinkError
        It is taken, or cannot be reached.
    """
    match = _ADDRESS.fullmatch(address)
    if not match or not 0 < int(match[2]) < 65536:
        raise ConfigurationError(
            f'{address!r} is no address: give udpout:HOST:PORT of the bridge, or udpin:HOST:PORT'
        )
    try:
        return mavutil.mavlink_connection(
            address,
            source_system=1,
            source_component=mavlink.MAV_COMP_ID_AUTOPILOT1,
            dialect='ardupilotmega',
        )
    except OSError as reason:
        raise LinkError(
            f'{address}: cannot be opened ({reason}): stop who listens there, or choose another'
        ) from None


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
        self.messages: dict[int, Callable[[int], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._estimator_status,
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
        stamp_ns = self._boot_ns + boot_ns
        elapsed = (stamp_ns - world.start_ns) / _NS
        pose = world.errors.estimated(world.flight, world.flight_time(stamp_ns), elapsed)
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

    def _estimator_status(self, boot_ns: int) -> Any:
        without_gps = self._world.faults.without_gps(self._uptime(boot_ns))
        # As large as a real one's in good weather; others with every fix.
        fixes = (boot_ns - round(without_gps * _NS)) // _FIX_NS
        ratios = np.array([0.02, 0.01, 0.0006]) * (0.5 + 0.4 * math.sin(2.4 * fixes))
        # ArduPilot flies on by its inertial sensors for as long before it says so; seconds.
        flags = _READY if without_gps < 7.0 else _WITHOUT_POSITION
        return mavlink.MAVLink_ekf_status_report_message(flags, *ratios, 0.02, 0.0)

    def _origin(self, boot_ns: int) -> Any:
        return mavlink.MAVLink_gps_global_origin_message(*_ORIGIN, boot_ns // 1000)

    def _attitude(self, boot_ns: int) -> Any:
        rotation = _NED_FROM_ENU * self._estimate(boot_ns).rotation * _FLU_FROM_FRD
        x, y, z, w = rotation.as_quat()
        _, rates = self._rates(boot_ns)
        return mavlink.MAVLink_attitude_quaternion_message(
            milliseconds(boot_ns), w, x, y, z, *_FLU_FROM_FRD.inv().apply(rates)
        )

    def _position(self, boot_ns: int) -> Any:
        return mavlink.MAVLink_local_position_ned_message(
            milliseconds(boot_ns),
            *_NED_FROM_ENU.apply(self._estimate(boot_ns).translation),
            *_NED_FROM_ENU.apply(self._rates(boot_ns)[0]),
        )

    def _rates(self, boot_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        world = self._world
        return world.flight.rates(world.flight_time(self._boot_ns + boot_ns))

    def _global_position(self, boot_ns: int) -> Any:
        place = self._estimate(boot_ns).translation
        velocity = np.rint(100 * _NED_FROM_ENU.apply(self._rates(boot_ns)[0])).astype(int)
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
            h_acc=800,
            v_acc=1200,
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


class Autopilot:
    """One vehicle on one link.

    Parameters
    ----------
    world : World
        Where the drone is at a ROS time.
    link : mavutil.mavfile
        From `open_link`.
    """

    def __init__(self, world: World, link: Any) -> None:
        self._link = link
        # It has been on for a minute.
        self._boot_ns = time.time_ns() - 60 * _NS
        self._telemetry = Telemetry(world, self._boot_ns, self.time_since_boot_ns())
        # Interval and next time of each message that is sent by itself, nanoseconds.
        self._streams: dict[int, tuple[int, int]] = {}
        for message_id, interval_us in _DEFAULTS_US.items():
            self._stream(message_id, interval_us)

    def run(self) -> None:
        """Fly and talk for ever."""
        self._send(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, self.time_since_boot_ns())
        while True:
            self._link.select(self._send_due() / 1e9)
            while (message := self._link.recv_msg()) is not None:
                self._answer(message)

    def time_since_boot_ns(self) -> int:
        """The boot clock, which ``time_boot_ms`` and TIMESYNC show."""
        return time.time_ns() - self._boot_ns

    def _stream(self, message_id: int, interval_us: int) -> None:
        """Send from the next multiple of the interval on: equal rates share their times."""
        # Whole milliseconds: that is what its clock counts.
        interval = interval_us // 1000 * 1_000_000
        self._streams.pop(message_id, None)
        if interval > 0:
            due = (self.time_since_boot_ns() // interval + 1) * interval
            self._streams[message_id] = interval, due

    def _send_due(self) -> int:
        """Send what is due; nanoseconds until the next one is."""
        now = self.time_since_boot_ns()
        for message_id, (interval, due) in list(self._streams.items()):
            # Messages that are late keep their time and are sent after each other, unless that is
            # hopeless.
            if due < now - _HOPELESS_NS:
                due = now // interval * interval
            while due <= now:
                self._send(message_id, due)
                due += interval
            self._streams[message_id] = interval, due
        next_ns = min([now + _NS, *(due for _, due in self._streams.values())])
        return max(next_ns - self.time_since_boot_ns(), 0)

    def _send(self, message_id: int, boot_ns: int) -> None:
        self._link.mav.send(self._telemetry.messages[message_id](boot_ns))

    def _answer(self, message: Any) -> None:
        kind = message.get_type()
        if kind == 'TIMESYNC' and message.tc1 == 0:
            now = self.time_since_boot_ns()
            self._link.mav.send(mavlink.MAVLink_timesync_message(now, message.ts1))
        elif kind == 'COMMAND_LONG' and message.target_system in (0, self._link.source_system):
            result = self._obey(message)
            self._link.mav.send(mavlink.MAVLink_command_ack_message(message.command, result))

    def _obey(self, message: Any) -> int:
        """Result of a COMMAND_LONG, a MAV_RESULT."""
        if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            number, interval = message.param1, message.param2
            usual = interval in (0, -1) or _SHORTEST_US <= interval <= _LONGEST_US
            if number not in _DEFAULTS_US or not usual:
                return mavlink.MAV_RESULT_DENIED
            self._stream(int(number), int(interval) or _DEFAULTS_US[int(number)])
        elif message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            if message.param1 not in self._telemetry.messages:
                return mavlink.MAV_RESULT_DENIED
            self._send(int(message.param1), self.time_since_boot_ns())
        else:
            return mavlink.MAV_RESULT_UNSUPPORTED
        return mavlink.MAV_RESULT_ACCEPTED


def build_parser() -> argparse.ArgumentParser:
    """Parser of the command line; its options are the parameters of a configuration."""
    parser = argparse.ArgumentParser(prog='simulated_autopilot', description='A simulated drone.')
    parser.add_argument('--scene', default='shipped:scene.yaml', help='default: %(default)s')
    parser.add_argument(
        '--address',
        default='udpout:127.0.0.1:14550',
        help='udpout:HOST:PORT or udpin:HOST:PORT; default: %(default)s',
    )
    parser.add_argument(
        '--start-ns', type=int, default=0, help='ROS time at which the flight starts, ns'
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM: 0; 2 for bad usage or input."""
    parsed = build_parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        world = read_world(parsed.scene, parsed.start_ns)
        Autopilot(world, open_link(parsed.address)).run()
    except FtpDentError as error:
        print(f'simulated_autopilot: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        ignore_signals()
    return 0


if __name__ == '__main__':
    sys.exit(main())
