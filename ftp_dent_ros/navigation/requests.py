"""What is asked of one autopilot: the time, its messages at their rates, and a few once."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.clock import ClockOffset
from ftp_dent_ros.navigation.origin import Earth
from ftp_dent_ros.navigation.settings import Instant, Settings
from ftp_dent_ros.navigation.trust import Trust

_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
_COMMANDS = ('COMMAND_LONG', 'COMMAND_INT')

# Seconds to an answer, and how often a request without one is repeated.
_ANSWER_TIMEOUT = 0.5
_RETRIES = 3
# Seconds that a rate is measured over at least.
_WINDOW = 2.0
# Between two requests for one message, doubled while they are of no use.
_PATIENCE, _LONGEST_PATIENCE = 0.5, 8.0
_ENOUGH = 0.8
# A stream is slow that by its own stamps is so, as many times running as no loss explains.
_STEPS = 4
# It has stayed away for as many intervals, and for longer than a link holds messages up; seconds.
_MISSED, _HELD_UP = 5, 0.1
# If nothing else came in the middle of a gap, link or autopilot halted: the share of it that is
# looked at, from either end. TIMESYNC alone is answered ten times a second.
_MIDDLE, _KEPT_TIMES = 0.25, 64
# For as long it is told who changed a rate.
_REMEMBERED = 10.0
# Hertz: what the map's origin is made of changes slowly.
_EARTH_RATE = 2.0


@dataclass(frozen=True)
class Meddling:
    """A change of rates.

    Attributes
    ----------
    who : str
        System and component, and the message that says so.
    message_id : int or None
        The message whose rate was set; None if that may be any.
    """

    who: str
    message_id: int | None


def meddler(message: Any, vehicle: tuple[int, int], our_system: int) -> Meddling | None:
    """Who changes rates by a message; None if nobody does, or we do.

    `vehicle` is system and component of the autopilot; we are the onboard computer of its system.
    """
    name, source = message.get_type(), (message.get_srcSystem(), message.get_srcComponent())
    ours = (our_system, mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    if name == 'COMMAND_ACK':
        target = (message.target_system, message.target_component)
        if source == vehicle and message.command == _INTERVAL and target not in (ours, (0, 0)):
            return Meddling(f'{target[0]}/{target[1]} (answered SET_MESSAGE_INTERVAL)', None)
        return None
    if name not in (*_COMMANDS, 'REQUEST_DATA_STREAM') or source in (ours, vehicle):
        return None
    if message.target_system not in (0, vehicle[0]):
        return None
    if name == 'REQUEST_DATA_STREAM':
        return Meddling(f'{source[0]}/{source[1]} (REQUEST_DATA_STREAM)', None)
    if message.command != _INTERVAL or not 0 <= message.param1 < 2**24:
        return None
    return Meddling(f'{source[0]}/{source[1]} (SET_MESSAGE_INTERVAL)', int(message.param1))


@dataclass
class Stream:
    """One message that is wanted.

    Attributes
    ----------
    name : str
        MAVLink's name of the message.
    rate : float
        Hz; the autopilot gets the interval in whole milliseconds, as ArduPilot counts.
    required : bool
        Whether it is asked for again after the autopilot has denied it.
    """

    name: str
    rate: float
    required: bool = True
    denied: bool = False
    asked: float | None = None
    wanted_since: float | None = None
    patience: float = _PATIENCE
    retries: int = 0
    is_disturbed: bool = False
    has_come: bool = False
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=4096))
    stamps: deque[int] = field(default_factory=lambda: deque(maxlen=_STEPS + 1))

    @property
    def message_id(self) -> int:
        """MAVLink's number of the message."""
        return int(getattr(mavlink, f'MAVLINK_MSG_ID_{self.name}'))

    @property
    def interval_us(self) -> int:
        """Interval to ask for."""
        return max(1, round(1000 / self.rate)) * 1000

    @property
    def window(self) -> float:
        """How far the measured rate looks back, seconds."""
        return max(_WINDOW, 5 / self.rate)

    def measured(self, now: float) -> float:
        """Rate over the last seconds, Hz."""
        while self.arrivals and self.arrivals[0] < now - self.window:
            self.arrivals.popleft()
        return len(self.arrivals) / self.window

    def is_slow(self, now: float) -> bool:
        """Whether it comes too slowly although it was first asked for some time ago."""
        has_had_time = self.wanted_since is not None and now - self.wanted_since > self.window
        return has_had_time and self.measured(now) < _ENOUGH * self.rate

    def steps(self) -> list[float]:
        """Times between its last stamps, in intervals."""
        return [1e3 * (b - a) / self.interval_us for a, b in pairwise(self.stamps)]

    def is_sparse(self) -> bool:
        """Whether its own stamps are too far apart: no link does that."""
        steps = self.steps()
        return len(steps) == _STEPS and min(steps) > 1 / _ENOUGH

    def flows(self) -> bool:
        """Whether since it was asked for it comes as it should."""
        steps = self.steps()
        return len(steps) == _STEPS and min(steps) <= 1 / _ENOUGH

    def stays_away(self, now: float) -> bool:
        """Whether it has come before, and now does not."""
        if not self.has_come or self.asked is None:
            return False
        last = max(self.asked, self.arrivals[-1]) if self.arrivals else self.asked
        return now - last > max(_HELD_UP, _MISSED / self.rate)

    def is_due(self, now: float) -> bool:
        """Whether it has to be asked for (again)."""
        if self.asked is None:
            return True
        if self.denied and not self.required:
            return False
        if self.flows() or self.measured(now) >= _ENOUGH * self.rate:
            self.patience = _PATIENCE
        is_bad = self.denied or self.is_disturbed or self.is_sparse() or self.stays_away(now)
        has_had_time = now - self.asked > self.window
        if not (is_bad or (has_had_time and self.is_slow(now) and not self.flows())):
            return False
        return now - self.asked > self.patience


class Streams:
    """All messages that are wanted of one autopilot."""

    def __init__(self, wanted: Iterable[Stream]) -> None:
        self._streams = {stream.name: stream for stream in wanted}
        self._ids = {stream.message_id: stream for stream in self._streams.values()}
        self._open: Stream | None = None
        self._rerated = 0
        self._rerated_at: float | None = None
        self._seen: tuple[float, str] | None = None
        self._heard = deque[float](maxlen=_KEPT_TIMES)

    def received(self, name: str, now: float, boot_ms: int | None = None) -> None:
        """Note that a message came, stamped with the autopilot's time."""
        self._heard.append(now)
        stream = self._streams.get(name)
        if stream is None:
            return
        if boot_ms is not None:
            if stream.stamps and boot_ms < stream.stamps[-1]:
                stream.stamps.clear()  # Wrapped, or overtaken.
            stream.stamps.append(boot_ms)
            has_gap = len(stream.stamps) > 1 and stream.steps()[-1] > _MISSED
            if has_gap and stream.arrivals and self._has_heard_between(stream.arrivals[-1], now):
                self._note_rerating(now)
        stream.arrivals.append(now)
        stream.has_come = True

    def meddled(self, who: str, now: float, message_id: int | None = None) -> None:
        """Somebody else was seen to set the rate of a message, or of no message by its number."""
        named = None if message_id is None else self._ids.get(message_id)
        if message_id is not None and named is None:
            return
        self._seen = now, who
        self._note_rerating(now)
        for stream in self._streams.values() if named is None else (named,):
            stream.is_disturbed = True

    def acknowledged(self, result: int) -> None:
        """Take the result of the COMMAND_ACK to the last request."""
        if self._open is not None and result != mavlink.MAV_RESULT_IN_PROGRESS:
            self._open.denied = result != mavlink.MAV_RESULT_ACCEPTED
            self._open = None

    def next_request(self, now: float) -> Stream | None:
        """The message to ask for now, if any."""
        unanswered = self._open
        if unanswered is not None and unanswered.asked is not None:
            if now - unanswered.asked < _ANSWER_TIMEOUT:
                return None
            self._open = None
            if unanswered.retries < _RETRIES:
                unanswered.retries += 1
                return self._ask(unanswered, now)
        for stream in self._streams.values():
            if stream.is_due(now):
                if stream.asked is not None:
                    stream.patience = min(2 * stream.patience, _LONGEST_PATIENCE)
                    if stream.is_sparse():
                        self._note_rerating(now)
                stream.retries = 0
                return self._ask(stream, now)
        return None

    def rates(self, now: float) -> dict[str, float]:
        """Measured rate of each message, Hz."""
        return {name: stream.measured(now) for name, stream in self._streams.items()}

    def slow(self, now: float) -> list[str]:
        """Names of the required messages that come too slowly."""
        return [s.name for s in self._streams.values() if s.required and s.is_slow(now)]

    def denied(self) -> list[str]:
        """Names of the required messages that the autopilot denies."""
        return [s.name for s in self._streams.values() if s.denied and s.required]

    @property
    def rerated(self) -> int:
        """How often somebody else changed a rate."""
        return self._rerated

    def rerated_by(self, now: float) -> str:
        """Who did so in the last seconds: '' for nobody, 'another client' if none was seen."""
        if self._rerated_at is None or now - self._rerated_at > _REMEMBERED:
            return ''
        if self._seen is None or now - self._seen[0] > _REMEMBERED:
            return 'another client'
        return self._seen[1]

    def _ask(self, stream: Stream, now: float) -> Stream:
        stream.asked = now
        if stream.wanted_since is None:
            stream.wanted_since = now
        stream.is_disturbed = False
        while len(stream.stamps) > 1:
            stream.stamps.popleft()
        self._open = stream
        return stream

    def _has_heard_between(self, begin: float, end: float) -> bool:
        """Whether anything came well between two times."""
        edge = _MIDDLE * (end - begin)
        return any(begin + edge < at < end - edge for at in self._heard)

    def _note_rerating(self, now: float) -> None:
        self._rerated += 1
        self._rerated_at = now


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
            *(Stream(*each, required=False) for each in self._trust.rates(autopilot).items()),
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
