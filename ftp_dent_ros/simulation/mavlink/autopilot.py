"""A simulated autopilot: real MAVLink 2 over a real link, a simulated drone behind it.

It flies the path from which the simulated camera photographs the skin, and behaves on the link
like an ArduCopter: until somebody asks, it sends no pose; what it sends bears the time of its own
boot clock. Run it as a process of its own::

    simulated_autopilot --scene shipped:scene.yaml --address udpout:127.0.0.1:14550
"""

from __future__ import annotations

import argparse
import math
import random
import signal
import sys
import time
from collections.abc import Sequence
from typing import Any

from ftp_dent_ros.errors import ConfigurationError, FtpDentError
from ftp_dent_ros.simulation.mavlink.link import Link, mavlink
from ftp_dent_ros.simulation.mavlink.telemetry import Telemetry
from ftp_dent_ros.simulation.world import World, read_world

_SECOND_US = 1_000_000
# Microseconds between two messages of a kind: 250 a second.
_SHORTEST_US = 4_000
_DEFAULTS_US = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _SECOND_US,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: _SECOND_US,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _SECOND_US,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 10 * _SECOND_US,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0,
}
# What REQUEST_DATA_STREAM of another client changes on an ArduCopter, and to what.
_RERATED = tuple(message_id for message_id, us in _DEFAULTS_US.items() if us == 0)
_RERATED_US = 500_000
# Messages that are late keep their time and are sent after each other, unless that is hopeless.
_MOST_LATE_NS = 500_000_000
_LONGEST_WAIT_NS = 500_000_000


class Autopilot:
    """One vehicle on one link.

    Parameters
    ----------
    world : World
        Where the drone is at a ROS time.
    link : Link
    uptime : float
        Seconds since its boot when it is made.
    """

    def __init__(self, world: World, link: Link, uptime: float) -> None:
        self._world, self._link = world, link
        self._boot_ns = time.time_ns() - round(uptime * 1e3) * 1_000_000
        self._intervals_us = dict(_DEFAULTS_US)
        self._due_ns: dict[int, int] = {}
        self._telemetry = Telemetry(world, self._boot_ns, self.time_since_boot_ns())
        self._started = time.monotonic()
        self._done = {'rerated': 0, 'triggered': 0}
        for message_id, interval in self._intervals_us.items():
            self._schedule(message_id, interval)

    def run(self) -> None:
        """Fly and talk for ever."""
        self._send(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, self.time_since_boot_ns())
        while True:
            self._interfere()
            wait_ns = self._send_due()
            for message in self._link.receive(wait_ns / 1e9):
                self._answer(message)

    def time_since_boot_ns(self) -> int:
        """The boot clock, which ``time_boot_ms`` and TIMESYNC show."""
        return time.time_ns() - self._boot_ns

    def _schedule(self, message_id: int, interval_us: int) -> None:
        """Send from the next multiple of the interval on: equal rates share their times."""
        self._intervals_us[message_id] = interval_us
        if interval_us > 0:
            interval_ns = interval_us * 1000
            self._due_ns[message_id] = (self.time_since_boot_ns() // interval_ns + 1) * interval_ns
        else:
            self._due_ns.pop(message_id, None)

    def _send_due(self) -> int:
        """Send what is due; nanoseconds until the next one is."""
        now = self.time_since_boot_ns()
        for message_id, due in list(self._due_ns.items()):
            interval = self._intervals_us[message_id] * 1000
            if due < now - _MOST_LATE_NS:
                due = now // interval * interval
            while due <= now:
                self._send(message_id, due)
                due += interval
            self._due_ns[message_id] = due
        # Also with nothing to send, a server that was lost is looked for.
        next_ns = min([now + _LONGEST_WAIT_NS, *self._due_ns.values()])
        return max(next_ns - self.time_since_boot_ns(), 0)

    def _send(self, message_id: int, boot_ns: int) -> None:
        self._link.send(self._telemetry.messages[message_id](boot_ns))

    def _answer(self, message: Any) -> None:
        kind = message.get_type()
        if kind == 'TIMESYNC' and message.tc1 == 0:
            now = self.time_since_boot_ns()
            self._link.send(mavlink.MAVLink_timesync_message(now, message.ts1))
        elif kind == 'COMMAND_LONG' and message.target_system in (0, self._link.system_id):
            result = self._obey(message)
            self._link.send(mavlink.MAVLink_command_ack_message(message.command, result))

    def _obey(self, message: Any) -> int:
        """Result of a COMMAND_LONG, a MAV_RESULT."""
        if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            if not all(map(math.isfinite, (message.param1, message.param2))):
                return mavlink.MAV_RESULT_DENIED
            return self._set_interval(int(message.param1), int(message.param2))
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            if message.param1 not in self._telemetry.messages:
                return mavlink.MAV_RESULT_DENIED
            self._send(int(message.param1), self.time_since_boot_ns())
            return mavlink.MAV_RESULT_ACCEPTED
        return mavlink.MAV_RESULT_UNSUPPORTED

    def _set_interval(self, message_id: int, interval_us: int) -> int:
        if message_id not in _DEFAULTS_US or 0 < interval_us < _SHORTEST_US or interval_us < -1:
            return mavlink.MAV_RESULT_DENIED
        if interval_us == 0:
            interval_us = _DEFAULTS_US[message_id]
        # Whole milliseconds: that is what its clock counts.
        self._schedule(message_id, interval_us // 1000 * 1000 if interval_us > 0 else 0)
        return mavlink.MAV_RESULT_ACCEPTED

    def _interfere(self) -> None:
        """What comes of others, when it is time."""
        faults = self._world.faults
        if self._is_time('rerated', faults.rerated_every):
            for message_id in _RERATED:
                if 0 < self._intervals_us[message_id] < _RERATED_US:
                    self._schedule(message_id, _RERATED_US)
        if self._is_time('triggered', faults.triggers_every):
            parameters = (0, 0, 1, self._done['triggered'], 0, 0, 0)
            capture = mavlink.MAV_CMD_IMAGE_START_CAPTURE
            self._link.send(mavlink.MAVLink_command_long_message(0, 0, capture, 0, *parameters))

    def _is_time(self, what: str, period: float) -> bool:
        due = period > 0 and time.monotonic() - self._started > (self._done[what] + 1) * period
        self._done[what] += due
        return due


def build_parser() -> argparse.ArgumentParser:
    """Parser of the command line; its options are the parameters of a configuration."""
    parser = argparse.ArgumentParser(prog='simulated_autopilot', description='A simulated drone.')
    parser.add_argument('--scene', default='shipped:scene.yaml', help='default: %(default)s')
    parser.add_argument(
        '--address',
        default='udpout:127.0.0.1:14550',
        help='udpout, udpin, tcp or tcpin:HOST:PORT; default: %(default)s',
    )
    parser.add_argument(
        '--start-ns', type=int, default=0, help='ROS time at which the flight starts, ns'
    )
    parser.add_argument('--system-id', type=int, default=1, help='default: %(default)s')
    parser.add_argument(
        '--uptime',
        type=float,
        help='seconds since boot at the start; default: 20 to 120 by chance',
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM: 0; 2 for bad usage or input."""
    parsed = build_parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        world = read_world(parsed.scene, parsed.start_ns)
        uptime = random.uniform(20, 120) if parsed.uptime is None else parsed.uptime
        if not 0 <= uptime < 1e9:
            raise ConfigurationError(f'--uptime is {uptime}: give seconds, 0 or more')
        if not 0 < parsed.system_id < 256:
            raise ConfigurationError(f'--system-id is {parsed.system_id}: give 1 to 255')
        Autopilot(world, Link(parsed.address, parsed.system_id), uptime).run()
    except FtpDentError as error:
        print(f'simulated_autopilot: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == '__main__':
    sys.exit(main())
