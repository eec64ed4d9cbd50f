"""The one autopilot that is believed: requests to it, and its poses.

There is no socket, no thread and no clock in here, so that a flight can be replayed through it
faster than it was flown.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import pose_covariance, pose_history
from ftp_dent_ros.navigation.clock import MILLISECOND, SECOND, ClockOffset
from ftp_dent_ros.navigation.origin import Earth
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.navigation.pose_history import PoseHistory
from ftp_dent_ros.navigation.report import Verdict, enum_name, number
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.trust import Trust
from ftp_dent_ros.pose import Pose

# A message that stays away is asked for again after as long, seconds (a link may hold messages up
# for a tenth of a second), or as many intervals; then after twice as long, and so on.
_PATIENCE, _MISSED = 0.1, 5
# Seconds between two requests at most, for a message without which there is no pose, and others.
_LONGEST_PAUSE, _LONGEST_PAUSE_OF_OTHERS = 8.0, 60.0
# Share of the rate asked for that is enough.
_ENOUGH = 0.8

# pymavlink makes its messages' fields at run time: no type checker knows them.
Message = Any

# An autopilot heartbeats at 1 Hz whatever else it sends; seconds.
_SILENCE = 1.5
# For as long after an ODOMETRY the messages that say less are left alone; seconds.
_PREFERRED = 0.5
# By then all has been heard of a moment that its pose depends on, nanoseconds: GPS gives a fix a
# second at least.
_SETTLED = SECOND
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
    is_needed : bool
        Whether there is no pose without it: then the pause between two requests doubles up to 8
        seconds, else up to a minute.
    """

    name: str
    rate: float
    is_needed: bool = False
    asked: float = -math.inf
    pause: float = 0.0
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=4096))

    def __post_init__(self) -> None:
        self._window = max(2.0, 5 / self.rate)
        self._patience = max(_PATIENCE, _MISSED / self.rate)

    def measured(self, now: float) -> float:
        """Rate over the last seconds, Hz."""
        while self.arrivals and self.arrivals[0] < now - self._window:
            self.arrivals.popleft()
        return len(self.arrivals) / self._window

    def is_slow(self, now: float) -> bool:
        """Whether it comes too slowly although it was asked for some time ago."""
        return now - self.asked > self._window and self.measured(now) < _ENOUGH * self.rate

    def receive(self, now: float) -> None:
        """Note that one has come."""
        self.arrivals.append(now)
        if self.measured(now) >= _ENOUGH * self.rate:
            self.pause = self._patience

    def request(self, vehicle: tuple[int, int], now: float) -> Message | None:
        """Request to send now, if it stays away or comes too slowly."""
        is_silent = not self.arrivals or now - self.arrivals[-1] > self.pause
        if now - self.asked <= self.pause or not (is_silent or self.is_slow(now)):
            return None
        longest = _LONGEST_PAUSE if self.is_needed else _LONGEST_PAUSE_OF_OTHERS
        self.pause = min(max(2 * self.pause, self._patience), longest)
        self.asked = now
        interval_us = max(1, round(1000 / self.rate)) * 1000
        number = getattr(mavlink, f'MAVLINK_MSG_ID_{self.name}')
        return _command(vehicle, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, interval_us)


def _command(target: tuple[int, int], command: int, first: float, second: float) -> Message:
    parameters = (first, second, 0, 0, 0, 0, 0)
    return mavlink.MAVLink_command_long_message(*target, command, 0, *parameters)


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
        self._settings = settings
        self._autopilot = mavlink.MAV_AUTOPILOT_INVALID
        self._heard = Instant(0, -math.inf)
        self._sequence = self._streamed_ros = 0
        self._counts = dict.fromkeys(
            ('messages', 'messages of others', 'messages lost', 'messages malformed'), 0
        )
        self._handlers: dict[str, Callable[[Message, Instant], None]] = {
            'TIMESYNC': self._on_timesync,
            'ATTITUDE_QUATERNION': self._on_pose,
            'LOCAL_POSITION_NED': self._on_pose,
            'ODOMETRY': self._on_pose,
        }
        self._start_anew(0)

    @property
    def system_id(self) -> int:
        """System id that a companion of this vehicle speaks with."""
        return self.identity[0] if self.identity else self._settings.system_id or 1

    def receive(self, message: Message, at: Instant) -> bool:
        """Take a message from anybody; return whether it is the autopilot's that is believed."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        name = message.get_type()
        if self.identity is None and self._is_wanted(message, source):
            self.identity, self._autopilot = source, message.autopilot
            self._sequence = message.get_seq() - 1
            self._start_anew(at.ros)
        if source != self.identity:
            self._counts['messages of others'] += 1
            return False
        self._counts['messages'] += 1
        missed = (message.get_seq() - self._sequence - 1) % 256
        # More than half a turn is a message that was overtaken or sent twice.
        self._counts['messages lost'] += missed if missed < 128 else 0
        self._sequence, self._heard = message.get_seq(), at
        if name in self._streams:
            self._streams[name].receive(at.steady)
        for handlers in (self._handlers, self._trust.handlers, self.earth.handlers):
            if name in handlers:
                handlers[name](message, at)
        return True

    def requests(self, at: Instant) -> list[Message]:
        """Messages that are due to be sent to the autopilot; ask some 20 times a second."""
        if self.identity is None:
            return []
        messages: list[Message] = []
        ts1 = self.clock.request(at.ros)
        if ts1 is not None:
            messages.append(mavlink.MAVLink_timesync_message(tc1=0, ts1=ts1))
        # One at a time: a thin line has little room.
        for stream in self._streams.values():
            request = stream.request(self.identity, at.steady)
            if request is not None:
                messages.append(request)
                break
        if self.earth.is_due(at.steady):
            once = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
            messages.append(_command(self.identity, *once, 0))
        return messages

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
        if self.identity is None:
            raise PoseAwaitedError('no autopilot has been heard on the link', 'no autopilot')
        try:
            reported, doubt = self._trust.check(stamp, self._heard.ros)
            boot, clock_doubt = self.clock.boot_time(stamp)
            pose, motion = self._history.at(boot)
        except PoseAwaitedError as error:
            if self.is_alive(at):
                raise
            silence = at.steady - self._heard.steady
            raise PoseAwaitedError(
                f'the autopilot has been silent for {silence:.1f} s ({error})', 'link lost'
            ) from None
        height_doubt = self._settings.height_scale_uncertainty * float(pose.translation[2])
        covariance = pose_covariance.of_tag(reported, motion, clock_doubt / 1e9, height_doubt)
        return Tag(pose, doubt + covariance, boot)

    def new_poses(self, at: Instant) -> list[tuple[int, Pose]]:
        """Poses that have become known since the last call, with their ROS times in ns.

        Their stamps follow the clock as it was last heard of, for a stream cannot wait.
        """
        fresh = self._history.fresh()
        if not self._trust.is_good(at.ros):
            return []
        poses = []
        for boot in fresh:
            stamp = self.clock.ros_time(boot)
            # After a step back of the clock the stream waits rather than repeat a time.
            if stamp is None or stamp <= self._streamed_ros:
                continue
            with contextlib.suppress(PoseError):
                poses.append((stamp, self._history.at(boot)[0]))
                self._streamed_ros = stamp
        return poses

    def is_alive(self, at: Instant) -> bool:
        """Whether the autopilot has been heard of late."""
        return at.steady - self._heard.steady < _SILENCE

    def verdict(self, at: Instant) -> Verdict:
        """What keeps a cloud of a moment ago from getting its pose; else what is not as wanted."""
        if not self.is_alive(at):
            return Verdict('error', 'the autopilot has fallen silent: check its power and cable')
        try:
            self.tag_at(at.ros - _SETTLED, at)
        except PoseError as error:
            is_awaited = isinstance(error, PoseAwaitedError)
            text = f'{error}: no cloud is tagged'
            return Verdict('warning' if is_awaited else 'error', text, error.reason)
        needed = [each for each in self._streams.values() if each.is_needed]
        slow = ' and '.join(each.name for each in needed if each.is_slow(at.steady))
        if slow and at.steady - self._odometry_heard > _PREFERRED:
            return Verdict('warning', f'too few {slow} come, asked for again: lower the rate')
        return Verdict('ok', 'believing the autopilot {}/{}'.format(*self.identity or (0, 0)))

    def figures(self, at: Instant) -> dict[str, str]:
        """What is known of the vehicle, by name, in the units that are in the names."""
        silence = at.steady - self._heard.steady if self.identity else None
        streams = self._streams.values()
        newest = self.clock.ros_time(self._history.newest) if self._history.newest else None
        return {
            'autopilot': enum_name('MAV_AUTOPILOT', self._autopilot),
            'system/component': '{}/{}'.format(*self.identity) if self.identity else 'none',
            'silence (s)': number(silence, 2),
            'pose age (ms)': number(None if newest is None else at.ros - newest, 1, 1e-6),
            'estimator resets': str(self._history.resets),
            **{name: str(count) for name, count in self._counts.items()},
            **self._trust.figures(at.ros),
            **self.clock.figures(at.ros),
            **self.earth.figures(),
            **{f'{each.name} (Hz)': f'{each.measured(at.steady):.1f}' for each in streams},
        }

    def _is_wanted(self, message: Message, source: tuple[int, int]) -> bool:
        return (
            message.get_type() == 'HEARTBEAT'
            and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            and source[0] == (self._settings.system_id or source[0])
            and source[1] == self._settings.component_id
        )

    def _start_anew(self, now: int) -> None:
        """The autopilot has just been found or has rebooted: it knows of no request."""
        self._trust, self.earth = Trust(self._settings, now), Earth()
        rate = self._settings.rate
        streams = [
            Stream('ATTITUDE_QUATERNION', rate, is_needed=True),
            Stream('LOCAL_POSITION_NED', rate, is_needed=True),
            Stream('ODOMETRY', rate),
            *(Stream(*each) for each in self._trust.rates(self._autopilot).items()),
        ]
        self._streams = {stream.name: stream for stream in streams}
        self._odometry_heard = -math.inf
        self._forget_poses()

    def _forget_poses(self) -> None:
        self._history = PoseHistory(_LONGEST_AGE, self._settings.maximum_gap)

    def _on_timesync(self, message: Message, at: Instant) -> None:
        repeated = self.clock.answer(message.tc1, message.ts1, at.ros)
        if repeated == 0:
            self._start_anew(at.ros)
        elif repeated is not None:
            self._history.repeat_from(repeated)

    def _on_pose(self, message: Message, at: Instant) -> None:
        attitude, position = pose_history.samples(message)
        if attitude is None and position is None:
            self._counts['messages malformed'] += 1
            return
        is_odometry = message.get_type() == 'ODOMETRY'
        boot = 1000 * message.time_usec if is_odometry else MILLISECOND * message.time_boot_ms
        wrap = 2**64 * 1000 if is_odometry else 2**32 * MILLISECOND
        stamp = self.clock.recent(boot, wrap, at.ros)
        is_preferred = at.steady - self._odometry_heard <= _PREFERRED
        if stamp is None or (is_preferred and not is_odometry):
            return
        if is_odometry:
            if not is_preferred:
                # The others' stamps are those of later moments: the two do not mix.
                self._forget_poses()
            self._odometry_heard = at.steady
        self._history.add(stamp, attitude, position)
