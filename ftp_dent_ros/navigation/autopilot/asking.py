"""What is asked of one autopilot: the time, its messages at their rates, and a few once."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.autopilot.earth import Earth
from ftp_dent_ros.navigation.autopilot.meddling import meddler
from ftp_dent_ros.navigation.autopilot.streams import Stream, Streams
from ftp_dent_ros.navigation.autopilot.trust import Trust
from ftp_dent_ros.navigation.autopilot.vehicle_state import Instant, Settings
from ftp_dent_ros.navigation.time_and_place.clock_offset import ClockOffset

_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
# Hertz: what the map's origin is made of changes slowly.
_EARTH_RATE = 2.0


class Asking:
    """Requests to an autopilot, and what comes of them.

    Parameters
    ----------
    settings : Settings
    clock : ClockOffset
    earth : Earth
        Knows what it still needs.
    trust : Trust
        Knows what it watches.
    """

    def __init__(self, settings: Settings, clock: ClockOffset, earth: Earth, trust: Trust) -> None:
        self._settings, self._clock, self._earth, self._trust = settings, clock, earth, trust
        self._streams = Streams([])
        self._rerated = 0

    def restart(self, autopilot: int) -> None:
        """An autopilot (a MAV_AUTOPILOT) has just been found or has rebooted: it knows nothing."""
        rate = self._settings.rate
        wanted = [
            Stream('ATTITUDE_QUATERNION', rate),
            Stream('LOCAL_POSITION_NED', rate),
            Stream('ODOMETRY', rate, required=False),
            Stream('SYSTEM_TIME', 1.0, required=False),
            *self._trust.streams(autopilot),
        ]
        if self._settings.earth and self._settings.position_source != 'gps':
            wanted.append(Stream('GLOBAL_POSITION_INT', _EARTH_RATE, required=False))
        self._rerated += self._streams.rerated
        self._streams = Streams(wanted)

    def overheard(
        self, message: Any, vehicle: tuple[int, int], our_system: int, now: float
    ) -> None:
        """Note who else sets rates, by a message of anybody's at a steady time."""
        meddling = meddler(message, vehicle, our_system)
        if meddling is not None:
            self._streams.meddled(meddling.who, now, meddling.message_id)

    def received(self, message: Any, now: float) -> None:
        """Note that a message of the autopilot's has come at a steady time."""
        boot_ms = getattr(message, 'time_boot_ms', None)
        self._streams.received(message.get_type(), now, boot_ms)

    def acknowledged(self, message: Any, our_system: int) -> None:
        """Take a COMMAND_ACK of the autopilot's."""
        # A MAVLink 1 autopilot leaves the addressee 0.
        ours = (our_system, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
        target = (message.target_system, message.target_component)
        if message.command == _INTERVAL and target in (ours, (0, 0)):
            self._streams.acknowledged(message.result)

    def due(self, vehicle: tuple[int, int], at: Instant) -> list[Any]:
        """Messages that are due to be sent."""
        messages: list[Any] = []
        ts1 = self._clock.request(at.ros)
        if ts1 is not None:
            messages.append(mavlink.MAVLink_timesync_message(tc1=0, ts1=ts1))
        stream = self._streams.next_request(at.steady)
        if stream is not None:
            wanted = stream.message_id, stream.interval_us
            messages.append(_command(vehicle, _INTERVAL, stream.retries, *wanted))
        once = self._earth.next_request(at.steady, height=self._settings.earth)
        if once is not None:
            messages.append(_command(vehicle, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, once, 0))
        return messages

    def state(self, now: float) -> dict[str, Any]:
        """What `VehicleState` holds of it, at a steady time."""
        return {
            'rates': self._streams.rates(now),
            'slow': self._streams.slow(now),
            'denied': self._streams.denied(),
            'rerated': self._rerated + self._streams.rerated,
            'rerated_by': self._streams.rerated_by(now),
        }


def _command(
    target: tuple[int, int], command: int, confirmation: int, first: float, second: float
) -> Any:
    parameters = (first, second, 0, 0, 0, 0, 0)
    return mavlink.MAVLink_command_long_message(*target, command, confirmation, *parameters)
