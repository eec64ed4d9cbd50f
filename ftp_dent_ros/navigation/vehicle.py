"""The one autopilot that is believed.

There is no socket, no thread and no clock in here, so that a flight can be replayed through it
faster than it was flown.
"""

from __future__ import annotations

import bisect
import contextlib
import math
from collections import deque
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import pose_covariance, pose_history
from ftp_dent_ros.navigation.clock import ClockOffset
from ftp_dent_ros.navigation.origin import Earth
from ftp_dent_ros.navigation.pose_covariance import Covariance, Tag
from ftp_dent_ros.navigation.pose_history import PoseHistory
from ftp_dent_ros.navigation.requests import Asking
from ftp_dent_ros.navigation.settings import Instant, Settings
from ftp_dent_ros.navigation.state import SILENCE, VehicleState
from ftp_dent_ros.navigation.trust import Trust
from ftp_dent_ros.pose import Pose

# For as long after an ODOMETRY the messages that say less are left alone; seconds.
_PREFERRED = 0.5
_KEPT_COVARIANCES, _KEPT_STEPS = 2048, 8

# pymavlink makes its messages' fields at run time: no type checker knows them.
Message = Any

# Poses are kept for as long, seconds: a cloud of a machine that has just restarted half of its
# processes may come 15 s after its photograph. TIMESYNC's drift (200 ppm) is 6 ms by then.
_LONGEST_AGE = 30.0
_LONGEST_LEAD = 1.0


class PoseSource:
    """Samples of one autopilot, by its time since boot in nanoseconds.

    Parameters
    ----------
    clock : ClockOffset
        Tells what times are possible.
    duration, maximum_gap : float
        As of `PoseHistory`.
    """

    def __init__(self, clock: ClockOffset, duration: float, maximum_gap: float) -> None:
        self._clock = clock
        self._maximum_gap = round(maximum_gap * 1e9)
        self._history = PoseHistory(duration, maximum_gap)
        self._covariances = deque[tuple[int, Covariance | None]](maxlen=_KEPT_COVARIANCES)
        self.malformed = 0
        self.clear()
        self.handlers = {
            'ATTITUDE_QUATERNION': self._on_attitude_quaternion,
            'LOCAL_POSITION_NED': self._on_local_position_ned,
            'ODOMETRY': self._on_odometry,
        }

    def clear(self) -> None:
        """Forget everything: the stamps start anew."""
        self._history.clear()
        self._covariances.clear()
        self._repeated = deque[tuple[int, int]](maxlen=_KEPT_STEPS)
        self._odometry_heard = -math.inf
        self._reset_counter: int | None = None

    @property
    def resets(self) -> int:
        """How often the estimator was reset."""
        return self._history.resets

    def at(self, boot: int) -> Pose:
        """As `PoseHistory.at`; `PoseError` also for a time that has come twice."""
        if any(first <= boot <= last for first, last in self._repeated):
            raise PoseError('a clock stepped back around that time', 'clock stepped')
        return self._history.at(boot)

    def repeat_from(self, boot: int) -> None:
        """The clock has stepped back: times from this one to the newest come twice."""
        self._repeated.append((boot, self._history.newest + self._maximum_gap))

    @property
    def newest(self) -> int:
        """As `PoseHistory.newest`."""
        return self._history.newest

    def stamps_since(self, boot: int) -> list[int]:
        """As `PoseHistory.stamps_since`."""
        return self._history.stamps_since(boot)

    def covariance(self, boot: int, reported: Covariance, clock_uncertainty: float) -> Covariance:
        """Covariance of the pose at a time that `at` has one for.

        `reported` is the estimator's, where ODOMETRY does not bring its own; the clock's
        uncertainty is in seconds.
        """
        after = bisect.bisect_left(self._covariances, boot, key=lambda item: item[0])
        is_odometry, own = False, None
        if after < len(self._covariances):
            stamp, own = self._covariances[after]
            is_odometry = stamp - boot <= self._maximum_gap
        estimate = own if is_odometry and own is not None else reported
        motion = self._history.motion(boot)
        return pose_covariance.of_tag(estimate, motion, clock_uncertainty, is_odometry)

    def _on_attitude_quaternion(self, message: Any, at: Instant) -> None:
        sample = pose_history.attitude(message)
        stamp = self._clock.unwrap(message.time_boot_ms, at.ros)
        if sample is None:
            self.malformed += 1
        elif stamp is not None and at.steady - self._odometry_heard > _PREFERRED:
            self._history.add_attitude(stamp, *sample)

    def _on_local_position_ned(self, message: Any, at: Instant) -> None:
        sample = pose_history.position(message)
        stamp = self._clock.unwrap(message.time_boot_ms, at.ros)
        if sample is None:
            self.malformed += 1
        elif stamp is not None and at.steady - self._odometry_heard > _PREFERRED:
            self._history.add_position(stamp, *sample)

    def _on_odometry(self, message: Any, at: Instant) -> None:
        sample = pose_history.odometry(message)
        stamp = 1000 * message.time_usec
        if sample is None:
            self.malformed += 1
        elif self._clock.is_plausible(stamp, at.ros):
            if at.steady - self._odometry_heard > _PREFERRED:
                # The others' stamps are those of later moments: the two do not mix.
                self.clear()
            self._odometry_heard = at.steady
            counter, self._reset_counter = self._reset_counter, message.reset_counter
            is_reset = counter is not None and counter != message.reset_counter
            self._history.add_attitude(stamp, *sample.attitude, is_reset)
            if self._history.add_position(stamp, *sample.position, is_reset):
                self._covariances.append((stamp, sample.covariance))


class Vehicle:
    """The autopilot that is believed: the first that heartbeats, and from then on only that."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._identity: tuple[int, int] | None = None
        self._autopilot = mavlink.MAV_AUTOPILOT_INVALID
        self._clock = ClockOffset(maximum_error=settings.maximum_clock_error)
        self._poses = PoseSource(self._clock, _LONGEST_AGE, settings.maximum_gap)
        self._earth = Earth(self._clock, self._poses.at)
        self._trust = Trust(settings)
        self._asking = Asking(settings, self._clock, self._earth, self._trust)
        self._heard: Instant | None = None
        self._sequence: int | None = None
        self._streamed = 0
        self._streamed_ros = 0
        self._utc_offset: int | None = None
        self._messages = self._foreign = self._lost = 0
        self._handlers = {
            'TIMESYNC': self._on_timesync,
            'COMMAND_ACK': self._on_command_ack,
            'SYSTEM_TIME': self._on_system_time,
        }
        self._listeners = [self._handlers, self._poses.handlers, self._trust.handlers]
        # Whether the map's origin moves is listened for in any case.
        said_alone = {name: self._earth.handlers[name] for name in ('GPS_GLOBAL_ORIGIN',)}
        self._listeners.append(self._earth.handlers if settings.earth else said_alone)

    @property
    def identity(self) -> tuple[int, int] | None:
        """System and component that are believed, once they are known."""
        return self._identity

    @property
    def system_id(self) -> int:
        """System id that a companion of this vehicle speaks with."""
        return self._identity[0] if self._identity else self._settings.system_id or 1

    def receive(self, message: Message, at: Instant) -> bool:
        """Take a message from anybody; tell whether it is the autopilot's that is believed."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        name = message.get_type()
        if self._identity is None and self._is_wanted(message, source, name):
            self._identity = source
            self._autopilot = message.autopilot
            self._start_anew(at)
        if self._identity is not None:
            self._asking.overheard(message, self._identity, self.system_id, at.steady)
        if source != self._identity:
            self._foreign += 1
            return False
        self._messages += 1
        self._count_losses(message.get_seq())
        self._heard = at
        self._asking.received(message, at.steady)
        for handlers in self._listeners:
            if name in handlers:
                handlers[name](message, at)
        return True

    def requests(self, at: Instant) -> list[Message]:
        """Messages that are due to be sent to the autopilot; ask some 20 times a second."""
        return [] if self._identity is None else self._asking.due(self._identity, at)

    def pose_at(self, stamp: int, at: Instant) -> Pose:
        """Pose of `tag_at`."""
        return self.tag_at(stamp, at).pose

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
        if age < -_LONGEST_LEAD:
            raise PoseError(
                f"the stamp is {-age:.1f} s ahead of this computer's clock", 'stamp in the future'
            )
        if self._identity is None:
            raise PoseAwaitedError('no autopilot has been heard on the link', 'no autopilot')
        heard = self._heard or at
        try:
            estimate, doubt = self._trust.check(stamp, heard.ros)
            boot, clock_doubt = self._clock.boot_time(stamp)
            pose = self._poses.at(boot)
        except PoseAwaitedError as error:
            silence = at.steady - heard.steady
            if silence < SILENCE:
                raise
            raise PoseAwaitedError(
                f'the autopilot has been silent for {silence:.1f} s ({error})', 'link lost'
            ) from None
        covariance = doubt + self._poses.covariance(boot, estimate, clock_doubt / 1e9)
        height = float(pose.translation[2])
        covariance += pose_covariance.of_height(height, self._settings.height_scale_uncertainty)
        return Tag(pose, covariance, boot)

    def new_poses(self, at: Instant) -> list[tuple[int, Pose]]:
        """Poses that have become known since the last call, with their ROS times in ns.

        Their stamps follow the clock as it was last heard of, for a stream cannot wait.
        """
        fresh = self._poses.stamps_since(self._streamed)
        if not fresh:
            return []
        self._streamed = fresh[-1]
        if not self._trust.is_good(at.ros):
            return []
        poses = []
        for boot in fresh:
            stamp = self._clock.ros_time(boot)
            # After a step back of the clock the stream waits rather than repeat a time.
            if stamp is None or stamp <= self._streamed_ros:
                continue
            with contextlib.suppress(PoseError):
                poses.append((stamp, self._poses.at(boot)))
                self._streamed_ros = stamp
        return poses

    def state(self, at: Instant) -> VehicleState:
        """State at this moment."""
        clock = self._clock.state(at.ros)
        utc_error = None
        if self._utc_offset is not None and clock.offset is not None:
            utc_error = clock.offset - self._utc_offset / 1e9
        newest = self._clock.ros_time(self._poses.newest) if self._poses.newest else None
        return VehicleState(
            identity=self._identity,
            autopilot=mavlink.enums['MAV_AUTOPILOT'][self._autopilot].name,
            silence=None if self._heard is None else at.steady - self._heard.steady,
            **self._trust.state(at.ros),
            clock=clock,
            utc_error=utc_error,
            **self._asking.state(at.steady),
            messages=self._messages,
            foreign=self._foreign,
            malformed=self._poses.malformed,
            lost=self._lost,
            resets=self._poses.resets,
            pose_age=None if newest is None else (at.ros - newest) / 1e9,
            origin=self._earth.origin,
            origin_error=self._earth.error,
        )

    def _is_wanted(self, message: Message, source: tuple[int, int], name: str) -> bool:
        return (
            name == 'HEARTBEAT'
            and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            and source[0] == (self._settings.system_id or source[0])
            and source[1] == self._settings.component_id
        )

    def _start_anew(self, at: Instant) -> None:
        """The autopilot has just been found or has rebooted: it knows of no request."""
        self._asking.restart(self._autopilot)
        self._poses.clear()
        self._streamed = 0
        self._earth.clear()
        self._trust.restart(at.ros)
        self._utc_offset = None

    def _count_losses(self, sequence: int) -> None:
        if self._sequence is not None:
            missed = (sequence - self._sequence - 1) % 256
            # More than half a turn is a message that was overtaken or sent twice.
            self._lost += missed if missed < 128 else 0
        self._sequence = sequence

    def _on_timesync(self, message: Message, at: Instant) -> None:
        if self._clock.answer(message.tc1, message.ts1, at.ros):
            self._start_anew(at)
        elif self._clock.repeated_from is not None:
            self._poses.repeat_from(self._clock.repeated_from)

    def _on_command_ack(self, message: Message, at: Instant) -> None:
        self._asking.acknowledged(message, self.system_id)

    def _on_system_time(self, message: Message, at: Instant) -> None:
        boot = self._clock.unwrap(message.time_boot_ms, at.ros)
        # Without GPS time the autopilot says 1970.
        if boot is not None and message.time_unix_usec > 0:
            self._utc_offset = message.time_unix_usec * 1000 - boot
