"""What is asked of one autopilot: the time, its messages at their rates, and a few once."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.clock import ClockOffset
from ftp_dent_ros.navigation.origin import Earth
from ftp_dent_ros.navigation.report import Verdict
from ftp_dent_ros.navigation.settings import Instant, Settings
from ftp_dent_ros.navigation.trust import Trust

_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
# Seconds between two requests for one message, doubled while they are of no use.
_PATIENCE = 0.5
# Share of the rate asked for that is enough.
_ENOUGH = 0.8
# Intervals without a message that no loss explains.
_MISSED = 5


@dataclass
class Stream:
    """One message that is wanted; times in seconds of steady time.

    Attributes
    ----------
    name : str
        MAVLink's name of the message.
    rate : float
        Hz; the autopilot gets the interval in whole milliseconds, as ArduPilot counts.
    required : bool
        Whether it is asked for again after the autopilot has denied it.
    stamps : deque of float
        Of the last messages, by the autopilot's clock where they bear its time, ms.
    """

    name: str
    rate: float
    required: bool = True
    is_denied: bool = False
    is_disturbed: bool = False
    first_asked: float | None = None
    asked: float = 0.0
    patience: float = _PATIENCE
    retries: int = 0
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=4096))
    stamps: deque[float] = field(default_factory=lambda: deque(maxlen=5))

    @property
    def interval_us(self) -> int:
        """Interval to ask for."""
        return max(1, round(1000 / self.rate)) * 1000

    @property
    def window(self) -> float:
        """How far the measured rate looks back, seconds."""
        return max(2.0, 5 / self.rate)

    def measured(self, now: float) -> float:
        """Rate over the last seconds, Hz."""
        while self.arrivals and self.arrivals[0] < now - self.window:
            self.arrivals.popleft()
        return len(self.arrivals) / self.window

    def is_slow(self, now: float) -> bool:
        """Whether it comes too slowly although it was first asked for some time ago."""
        has_had_time = self.first_asked is not None and now - self.first_asked > self.window
        return has_had_time and self.measured(now) < _ENOUGH * self.rate

    def steps(self) -> list[float]:
        """Times between its last stamps, in intervals."""
        return [1e3 * (b - a) / self.interval_us for a, b in pairwise(self.stamps)]

    def is_late(self, now: float) -> bool:
        """Whether its last stamps are too far apart, as no loss explains, or it stays away."""
        steps = self.steps()
        if len(steps) == 4 and min(steps) > 1 / _ENOUGH:
            return True
        # A link may hold messages up for a tenth of a second; the first takes its time.
        patience = max(0.1, _MISSED / self.rate) if self.stamps else self.window
        last = self.arrivals[-1] if self.arrivals else self.asked
        return now - max(self.asked, last) > patience

    def is_due(self, now: float) -> bool:
        """Whether it has to be asked for (again)."""
        if self.first_asked is None:
            return True
        if self.is_denied and not self.required:
            return False
        is_bad = self.is_denied or self.is_disturbed or self.is_late(now)
        return is_bad and now - self.asked > self.patience


class Requests:
    """Requests to an autopilot, and what comes of them.

    Parameters
    ----------
    settings : Settings
    clock : ClockOffset
    earth : Earth
        Knows what it still needs.
    trust : Trust
        Knows what it watches.

    Attributes
    ----------
    rerated : int
        How often another client changed a rate.
    """

    def __init__(self, settings: Settings, clock: ClockOffset, earth: Earth, trust: Trust) -> None:
        self._settings, self._clock, self._earth, self._trust = settings, clock, earth, trust
        self.rerated = 0
        self._rerated_at = -math.inf
        self._streams: dict[str, Stream] = {}
        self._open: Stream | None = None
        self._heard = deque[float](maxlen=64)

    def restart(self, autopilot: int) -> None:
        """An autopilot (a MAV_AUTOPILOT) has just been found or has rebooted: it knows nothing."""
        rate = self._settings.rate
        wanted = [
            Stream('ATTITUDE_QUATERNION', rate),
            Stream('LOCAL_POSITION_NED', rate),
            Stream('ODOMETRY', rate, required=False),
            Stream('SYSTEM_TIME', 1.0, required=False),
            *(Stream(*each, required=False) for each in self._trust.rates(autopilot).items()),
        ]
        if self._settings.earth and self._settings.position_source != 'gps':
            wanted.append(Stream('GLOBAL_POSITION_INT', 2.0, required=False))
        self._streams = {stream.name: stream for stream in wanted}
        self._open = None

    def overhear(
        self, message: Any, vehicle: tuple[int, int], our_system: int, now: float
    ) -> None:
        """Note whether another client sets rates, by a message of anybody's at a steady time.

        `vehicle` is system and component of the autopilot; we are the onboard computer of its
        system.
        """
        name, source = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
        ours = (our_system, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
        if name == 'COMMAND_ACK':
            target = (message.target_system, message.target_component)
            is_other = source == vehicle and target not in (ours, (0, 0))
        else:
            is_other = source not in (ours, vehicle)
        if name in ('COMMAND_LONG', 'COMMAND_INT', 'REQUEST_DATA_STREAM'):
            is_other = is_other and message.target_system in (0, vehicle[0])
        elif name != 'COMMAND_ACK':
            return
        if is_other and (name == 'REQUEST_DATA_STREAM' or message.command == _INTERVAL):
            self._note_rerating(now)
            for stream in self._streams.values():
                stream.is_disturbed = True

    def receive(self, message: Any, now: float) -> None:
        """Note that a message of the autopilot's has come at a steady time."""
        self._heard.append(now)
        stream = self._streams.get(message.get_type())
        if stream is None:
            return
        stamp = getattr(message, 'time_boot_ms', 1e3 * now)
        if stream.stamps and stamp < stream.stamps[-1]:
            stream.stamps.clear()  # Wrapped, or overtaken.
        stream.stamps.append(stamp)
        steps = stream.steps()
        if len(steps) == 4 and min(steps) <= 1 / _ENOUGH:
            stream.patience = _PATIENCE
        if steps and steps[-1] > _MISSED and stream.arrivals:
            # If nothing else came in the middle of the gap, link or autopilot halted.
            begin, edge = stream.arrivals[-1], 0.25 * (now - stream.arrivals[-1])
            if any(begin + edge < at < now - edge for at in self._heard):
                self._note_rerating(now)
        stream.arrivals.append(now)

    def acknowledge(self, message: Any, our_system: int) -> None:
        """Take a COMMAND_ACK of the autopilot's."""
        # A MAVLink 1 autopilot leaves the addressee 0.
        ours = (our_system, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
        target = (message.target_system, message.target_component)
        is_ours = message.command == _INTERVAL and target in (ours, (0, 0))
        if is_ours and self._open and message.result != mavlink.MAV_RESULT_IN_PROGRESS:
            self._open.is_denied = message.result != mavlink.MAV_RESULT_ACCEPTED
            self._open = None

    def due(self, vehicle: tuple[int, int], at: Instant) -> list[Any]:
        """Messages that are due to be sent."""
        messages: list[Any] = []
        ts1 = self._clock.request(at.ros)
        if ts1 is not None:
            messages.append(mavlink.MAVLink_timesync_message(tc1=0, ts1=ts1))
        stream = self._next_stream(at.steady)
        if stream is not None:
            message_id = getattr(mavlink, f'MAVLINK_MSG_ID_{stream.name}')
            wanted = message_id, stream.interval_us
            messages.append(_command(vehicle, _INTERVAL, stream.retries, *wanted))
        once = self._earth.next_request(at.steady)
        if once is not None:
            messages.append(_command(vehicle, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, once, 0))
        return messages

    @property
    def denied(self) -> list[str]:
        """Names of the required messages that the autopilot denies."""
        return [each.name for each in self._streams.values() if each.is_denied and each.required]

    def verdict(self, now: float) -> Verdict | None:
        """What is wrong with the streams, at a steady time."""
        if now - self._rerated_at < 10:
            return Verdict(
                'warning',
                'some poses are missing: another client changes the rates of messages; they are '
                'asked for again at once each time',
            )
        slow = [s.name for s in self._streams.values() if s.required and s.is_slow(now)]
        if slow:
            return Verdict('warning', f'too few {" and ".join(slow)} come; asked for again')
        return None

    def figures(self, now: float) -> dict[str, str]:
        """What is known of the streams, at a steady time."""
        rates = {f'{each.name} (Hz)': each.measured(now) for each in self._streams.values()}
        return {
            'rates changed by others': str(self.rerated),
            **{name: f'{rate:.1f}' for name, rate in rates.items()},
        }

    def _next_stream(self, now: float) -> Stream | None:
        """The message to ask for now, if any."""
        unanswered = self._open
        if unanswered is not None:
            if now - unanswered.asked < 0.5:
                return None
            self._open = None
            if unanswered.retries < 3:
                unanswered.retries += 1
                return self._ask(unanswered, now)
        for stream in self._streams.values():
            if stream.is_due(now):
                if stream.first_asked is not None:
                    stream.patience = min(2 * stream.patience, 8.0)
                stream.retries = 0
                return self._ask(stream, now)
        return None

    def _ask(self, stream: Stream, now: float) -> Stream:
        stream.asked = now
        if stream.first_asked is None:
            stream.first_asked = now
        stream.is_disturbed = False
        while len(stream.stamps) > 1:
            stream.stamps.popleft()
        self._open = stream
        return stream

    def _note_rerating(self, now: float) -> None:
        self.rerated += 1
        self._rerated_at = now


def _command(
    target: tuple[int, int], command: int, confirmation: int, first: float, second: float
) -> Any:
    parameters = (first, second, 0, 0, 0, 0, 0)
    return mavlink.MAVLink_command_long_message(*target, command, confirmation, *parameters)
