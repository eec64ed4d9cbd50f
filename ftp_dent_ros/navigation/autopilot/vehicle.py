"""What is known of the one autopilot that is believed, from its messages alone.

Messages and their times of arrival go in, requests to send come out; there is no socket, no
thread and no clock in here, so that a flight can be replayed through it faster than it was flown.
"""

from __future__ import annotations

import contextlib
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.autopilot.asking import Asking
from ftp_dent_ros.navigation.autopilot.earth import Earth
from ftp_dent_ros.navigation.autopilot.pose_source import PoseSource
from ftp_dent_ros.navigation.autopilot.trust import Trust
from ftp_dent_ros.navigation.autopilot.vehicle_state import (
    SILENCE,
    Instant,
    Settings,
    VehicleState,
)
from ftp_dent_ros.navigation.poses import accuracy
from ftp_dent_ros.navigation.poses.accuracy import Tag
from ftp_dent_ros.navigation.time_and_place.clock_offset import ClockOffset
from ftp_dent_ros.pose import Pose

# pymavlink makes its messages' fields at run time: no type checker knows them.
Message = Any

# Poses are kept for as long, seconds: a cloud of a machine that has just restarted half of its
# processes may come 15 s after its photograph. TIMESYNC's drift (200 ppm) is 6 ms by then.
_LONGEST_AGE = 30.0
_LONGEST_LEAD = 1.0


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
        covariance += accuracy.of_height(height, self._settings.height_scale_uncertainty)
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
