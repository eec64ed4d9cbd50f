"""The one autopilot that is believed: requests to it, and its poses.

There is no socket, no thread and no clock in here, so that a flight can be replayed through it
faster than it was flown.
"""

from __future__ import annotations

import bisect
import contextlib
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import pose_covariance, pose_history
from ftp_dent_ros.navigation.clock import SECOND, ClockOffset
from ftp_dent_ros.navigation.origin import Earth
from ftp_dent_ros.navigation.pose_covariance import Covariance, Tag
from ftp_dent_ros.navigation.pose_history import PoseHistory, Sample
from ftp_dent_ros.navigation.report import Verdict, number
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.trust import Trust
from ftp_dent_ros.pose import Pose

_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
# Seconds between two requests for one message, doubled while they are of no use.
_PATIENCE = 0.5
# Share of the rate asked for that is enough.
_ENOUGH = 0.8
# Intervals without a message that no loss explains.
_MISSED = 5

# pymavlink makes its messages' fields at run time: no type checker knows them.
Message = Any

# An autopilot heartbeats at 1 Hz whatever else it sends; seconds.
_SILENCE = 1.5
# For as long after an ODOMETRY the messages that say less are left alone; seconds.
_PREFERRED = 0.5
# Poses are kept for as long, seconds: a cloud of a machine that has just restarted half of its
# processes may come 15 s after its photograph. TIMESYNC's drift (200 ppm) is 6 ms by then.
_LONGEST_AGE = 30.0


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
    settings : VehicleSettings
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

    def __init__(
        self, settings: VehicleSettings, clock: ClockOffset, earth: Earth, trust: Trust
    ) -> None:
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


class Vehicle:
    """The autopilot that is believed: the first that heartbeats, and from then on only that.

    Attributes
    ----------
    identity : tuple of int, or None
        System and component, once they are known.
    clock : ClockOffset
    earth : Earth
    """

    def __init__(self, settings: VehicleSettings) -> None:
        self.identity: tuple[int, int] | None = None
        self.clock = ClockOffset(maximum_error=settings.maximum_clock_error)
        self.earth = Earth(self.clock, self._pose, settings.earth)
        self._settings = settings
        self._autopilot = mavlink.MAV_AUTOPILOT_INVALID
        self._history = PoseHistory(_LONGEST_AGE, settings.maximum_gap)
        self._trust = Trust(settings)
        self._requests = Requests(settings, self.clock, self.earth, self._trust)
        self._heard: Instant | None = None
        self._sequence: int | None = None
        self._streamed = self._streamed_ros = 0
        self._messages = self._foreign = self._lost = self._malformed = 0
        # Of ODOMETRY, by its stamps; and spans of the time since boot that came twice.
        self._covariances = deque[tuple[int, Covariance | None]](maxlen=2048)
        self._repeated = deque[tuple[int, int]](maxlen=8)
        handlers: dict[str, Callable[[Message, Instant], None]] = {
            'TIMESYNC': self._on_timesync,
            'COMMAND_ACK': self._on_command_ack,
            'SYSTEM_TIME': self._on_system_time,
            'ATTITUDE_QUATERNION': self._on_attitude_quaternion,
            'LOCAL_POSITION_NED': self._on_local_position_ned,
            'ODOMETRY': self._on_odometry,
        }
        self._handlers = [handlers, self._trust.handlers, self.earth.handlers]
        self._clear()

    @property
    def system_id(self) -> int:
        """System id that a companion of this vehicle speaks with."""
        return self.identity[0] if self.identity else self._settings.system_id or 1

    def receive(self, message: Message, at: Instant) -> bool:
        """Take a message from anybody; return whether it is the autopilot's that is believed."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        name = message.get_type()
        if self.identity is None and self._is_wanted(message, source, name):
            self.identity = source
            self._autopilot = message.autopilot
            self._start_anew(at)
        if self.identity is not None:
            self._requests.overhear(message, self.identity, self.system_id, at.steady)
        if source != self.identity:
            self._foreign += 1
            return False
        self._messages += 1
        self._count_losses(message.get_seq())
        self._heard = at
        self._requests.receive(message, at.steady)
        for handlers in self._handlers:
            if name in handlers:
                handlers[name](message, at)
        return True

    def requests(self, at: Instant) -> list[Message]:
        """Messages that are due to be sent to the autopilot; ask some 20 times a second."""
        return [] if self.identity is None else self._requests.due(self.identity, at)

    def tag_at(self, stamp: int, at: Instant) -> Tag:
        """Pose of `base_link` in `map` at a ROS time in nanoseconds, and its covariance.

        It is given only once the clock, the estimator and the pose have all been heard of from
        both before and after the stamp, so that nothing heard later could take it back.

        Raises
        ------
        PoseAwaitedError
            Something that is needed may still come.
        PoseError
            There is no trustworthy pose at that time, and will be none.
        """
        age = (at.ros - stamp) / 1e9
        if age > _LONGEST_AGE:
            raise PoseError(f'the stamp is {age:.1f} s old', 'too old')
        if age < -1:
            raise PoseError(
                f"the stamp is {-age:.1f} s ahead of this computer's clock", 'stamp in the future'
            )
        if self.identity is None or self._heard is None:
            raise PoseAwaitedError('no autopilot has been heard on the link', 'no autopilot')
        try:
            estimate, doubt = self._trust.check(stamp, self._heard.ros)
            boot, clock_doubt = self.clock.boot_time(stamp)
            pose = self._pose(boot)
        except PoseAwaitedError as error:
            if self.is_alive(at):
                raise
            silence = at.steady - self._heard.steady
            raise PoseAwaitedError(
                f'the autopilot has been silent for {silence:.1f} s ({error})', 'link lost'
            ) from None
        covariance = doubt + self._covariance(boot, estimate, clock_doubt / 1e9)
        height = float(pose.translation[2])
        covariance += pose_covariance.of_height(height, self._settings.height_scale_uncertainty)
        return Tag(pose, covariance, boot)

    def new_poses(self, at: Instant) -> list[tuple[int, Pose]]:
        """Poses that have become known since the last call, with their ROS times in ns.

        Their stamps follow the clock as it was last heard of, for a stream cannot wait.
        """
        fresh = self._history.stamps_since(self._streamed)
        if not fresh:
            return []
        self._streamed = fresh[-1]
        if not self._trust.is_good(at.ros):
            return []
        poses = []
        for boot in fresh:
            stamp = self.clock.ros_time(boot)
            # After a step back of the clock the stream waits rather than repeat a time.
            if stamp is None or stamp <= self._streamed_ros:
                continue
            with contextlib.suppress(PoseError):
                poses.append((stamp, self._pose(boot)))
                self._streamed_ros = stamp
        return poses

    def is_alive(self, at: Instant) -> bool:
        """Whether the autopilot has been heard of late."""
        return self._heard is not None and at.steady - self._heard.steady < _SILENCE

    def verdict(self, at: Instant) -> Verdict:
        """The first thing that is wrong with a vehicle that was heard, and what to do about it."""
        if not self.is_alive(at):
            return Verdict('error', 'the autopilot has fallen silent: check its power and cable')
        if self._requests.denied:
            denied = ' and '.join(self._requests.denied)
            return Verdict('error', f'the autopilot denies {denied}: lower the rate')
        return (
            self.clock.verdict(at.ros)
            or self._trust.verdict(at.ros)
            or self._requests.verdict(at.steady)
            or Verdict('ok', 'believing the autopilot {}/{}'.format(*self.identity or (0, 0)))
        )

    def figures(self, at: Instant) -> dict[str, str]:
        """What is known of the vehicle, by name, in the units that are in the names."""
        silence = None if self._heard is None else at.steady - self._heard.steady
        newest = self.clock.ros_time(self._history.newest) if self._history.newest else None
        ahead = None
        if self.clock.offset is not None and self._utc_offset is not None:
            ahead = self.clock.offset - self._utc_offset
        return {
            'autopilot': mavlink.enums['MAV_AUTOPILOT'][self._autopilot].name,
            'system/component': '{}/{}'.format(*self.identity) if self.identity else 'none',
            'silence (s)': number(silence, 2),
            'pose age (ms)': number(None if newest is None else at.ros - newest, 1, 1e-6),
            'estimator resets': str(self._history.resets),
            'ahead of UTC of GPS (s)': number(ahead, 3),
            'messages': str(self._messages),
            'messages of others': str(self._foreign),
            'messages lost': str(self._lost),
            'messages malformed': str(self._malformed),
            **self._trust.figures(at.ros),
            **self.clock.figures(at.ros),
            **self.earth.figures(),
            **self._requests.figures(at.steady),
        }

    def _pose(self, boot: int) -> Pose:
        """Pose at a time since boot; PoseError also for a time that has come twice."""
        if any(first <= boot <= last for first, last in self._repeated):
            raise PoseError('a clock stepped back around that time', 'clock stepped')
        return self._history.at(boot)

    def _covariance(self, boot: int, reported: Covariance, clock_doubt: float) -> Covariance:
        """Covariance of the pose at a time since boot; the clock's doubt is in seconds.

        `reported` is the estimator's, where ODOMETRY does not bring its own.
        """
        after = bisect.bisect_left(self._covariances, boot, key=lambda item: item[0])
        is_odometry, own = False, None
        if after < len(self._covariances):
            stamp, own = self._covariances[after]
            is_odometry = stamp - boot <= self._settings.maximum_gap * SECOND
        estimate = own if is_odometry and own is not None else reported
        motion = self._history.motion(boot)
        return pose_covariance.of_tag(estimate, motion, clock_doubt, is_odometry)

    def _is_wanted(self, message: Message, source: tuple[int, int], name: str) -> bool:
        return (
            name == 'HEARTBEAT'
            and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            and source[0] == (self._settings.system_id or source[0])
            and source[1] == self._settings.component_id
        )

    def _start_anew(self, at: Instant) -> None:
        """The autopilot has just been found or has rebooted: it knows of no request."""
        self._requests.restart(self._autopilot)
        self._trust.restart(at.ros)
        self.earth.clear()
        self._clear()

    def _clear(self) -> None:
        self._utc_offset: float | None = None
        self._streamed = 0
        self._clear_poses()

    def _clear_poses(self) -> None:
        """Forget all poses: their stamps start anew."""
        self._history.clear()
        self._covariances.clear()
        self._repeated.clear()
        self._odometry_heard = -math.inf
        self._reset_counter: int | None = None

    def _count_losses(self, sequence: int) -> None:
        if self._sequence is not None:
            missed = (sequence - self._sequence - 1) % 256
            # More than half a turn is a message that was overtaken or sent twice.
            self._lost += missed if missed < 128 else 0
        self._sequence = sequence

    def _on_timesync(self, message: Message, at: Instant) -> None:
        if self.clock.answer(message.tc1, message.ts1, at.ros):
            self._start_anew(at)
        elif self.clock.repeated_from is not None:
            gap = round(self._settings.maximum_gap * SECOND)
            self._repeated.append((self.clock.repeated_from, self._history.newest + gap))

    def _on_command_ack(self, message: Message, at: Instant) -> None:
        self._requests.acknowledge(message, self.system_id)

    def _on_system_time(self, message: Message, at: Instant) -> None:
        boot = self.clock.unwrap(message.time_boot_ms, at.ros)
        # Without GPS time the autopilot says 1970.
        if boot is not None and message.time_unix_usec > 0:
            self._utc_offset = (message.time_unix_usec * 1000 - boot) / 1e9

    def _on_attitude_quaternion(self, message: Message, at: Instant) -> None:
        sample = pose_history.attitude(message)
        self._add(self._history.add_attitude, sample, message, at)

    def _on_local_position_ned(self, message: Message, at: Instant) -> None:
        sample = pose_history.position(message)
        self._add(self._history.add_position, sample, message, at)

    def _add(
        self, add: Callable[..., bool], sample: Sample | None, message: Message, at: Instant
    ) -> None:
        stamp = self.clock.unwrap(message.time_boot_ms, at.ros)
        if sample is None:
            self._malformed += 1
        elif stamp is not None and at.steady - self._odometry_heard > _PREFERRED:
            add(stamp, *sample)

    def _on_odometry(self, message: Message, at: Instant) -> None:
        samples = pose_history.odometry(message)
        stamp = 1000 * message.time_usec
        if samples is None:
            self._malformed += 1
        elif self.clock.is_plausible(stamp, at.ros):
            if at.steady - self._odometry_heard > _PREFERRED:
                # The others' stamps are those of later moments: the two do not mix.
                self._clear_poses()
            self._odometry_heard = at.steady
            attitude, position, covariance = samples
            counter, self._reset_counter = self._reset_counter, message.reset_counter
            is_reset = counter is not None and counter != message.reset_counter
            self._history.add_attitude(stamp, *attitude, is_reset)
            if self._history.add_position(stamp, *position, is_reset):
                self._covariances.append((stamp, covariance))
