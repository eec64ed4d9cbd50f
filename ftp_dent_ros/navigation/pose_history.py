"""Poses out of the autopilot's messages, kept for a while and interpolated."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import frames, pose_covariance
from ftp_dent_ros.navigation.pose_covariance import Covariance, Motion
from ftp_dent_ros.pose import Pose

# Steps beyond what the rates explain. A flight's own are within 0.13 degrees and 3 mm at 50 Hz.
_ROTATION_JUMP = np.radians(1.0)
_POSITION_JUMP = 0.05

_Vector = NDArray[np.float64]


class Sample(NamedTuple):
    """One quantity at a moment.

    Attributes
    ----------
    value : ndarray
        Attitude (x, y, z, w; FLU -> ENU), or position in `map`, metres.
    rate : ndarray, shape (3,)
        Body rates (FLU, rad/s), or velocity in `map`, m/s.
    resets : int or None
        How many resets of the estimator ODOMETRY has counted; None of what does not count them.
    covariance : ndarray, shape (6, 6), or None
        The pose's own, where ODOMETRY brings it.
    is_reset : bool
        Whether the estimator was reset since the sample before, or another message tells of it.
    """

    value: _Vector
    rate: _Vector
    resets: int | None = None
    covariance: Covariance | None = None
    is_reset: bool = False


@dataclass
class Track:
    """Samples of one quantity, in the order of their stamps.

    A sample that lies further from where its neighbour was heading than `jump` is no motion but
    a reset of the estimator; samples far apart may also have been accelerated.
    """

    name: str
    duration: int
    step: Callable[[_Vector, _Vector], _Vector]
    jump: float
    acceleration: float
    stamps: list[int] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    resets: int = 0

    def add(self, stamp: int, sample: Sample) -> None:
        """Take a sample, unless it is not newer than the last."""
        if self.stamps:
            seconds, last = (stamp - self.stamps[-1]) / 1e9, self.samples[-1]
            if seconds <= 0:
                return
            off = self.step(sample.value, last.value) - (last.rate + sample.rate) / 2 * seconds
            most = self.jump + self.acceleration * seconds**2 / 4
            is_reset = sample.resets != last.resets or bool(np.linalg.norm(off) > most)
            sample = sample._replace(is_reset=is_reset)
        self.resets += sample.is_reset
        self.stamps.append(stamp)
        self.samples.append(sample)
        expired = bisect.bisect_left(self.stamps, stamp - self.duration)
        if expired > len(self.stamps) // 2:
            del self.stamps[:expired], self.samples[:expired]

    def around(self, stamp: int, maximum_gap: int) -> tuple[Sample, Sample, float, float]:
        """The samples around a stamp, their gap in seconds, and where in it it lies, 0 to 1."""
        if not self.stamps or stamp > self.stamps[-1]:
            raise PoseAwaitedError(
                f'no {self.name} has come from the autopilot since the stamp',
                'later sample awaited',
            )
        if stamp < self.stamps[0]:
            raise PoseError(
                f'the stamp is {_ms(self.stamps[0] - stamp)} older than the oldest {self.name}',
                'too old',
            )
        index = bisect.bisect_left(self.stamps, stamp)
        after = self.samples[index]
        if self.stamps[index] == stamp:
            return after, after, 0.0, 0.0
        gap = self.stamps[index] - self.stamps[index - 1]
        if after.is_reset:
            raise PoseError(
                f"the estimator's {self.name} jumped at the time of the stamp", 'estimator reset'
            )
        if gap > maximum_gap:
            raise PoseError(
                f'no {self.name} came for {_ms(gap)} around the stamp, more than '
                f'{_ms(maximum_gap)}',
                'gap in the samples',
            )
        share = (stamp - self.stamps[index - 1]) / gap
        return self.samples[index - 1], after, gap / 1e9, share


class PoseHistory:
    """Samples of attitude and position, and the pose at any time between them.

    Stamps are nanoseconds since the autopilot's boot.

    Parameters
    ----------
    duration : float
        How long samples are kept, seconds.
    maximum_gap : float
        Longest time between two samples that is interpolated across, seconds.
    """

    def __init__(self, duration: float = 10.0, maximum_gap: float = 0.15) -> None:
        self._maximum_gap = round(maximum_gap * 1e9)
        kept = round(duration * 1e9)
        self._attitudes = Track('attitude', kept, _turn, _ROTATION_JUMP, 10.0)
        self._positions = Track('position', kept, np.subtract, _POSITION_JUMP, 20.0)
        # Spans of the time since boot that came twice.
        self._repeated = deque[tuple[int, int]](maxlen=8)
        self._given = 0

    def add(self, stamp: int, attitude: Sample | None, position: Sample | None) -> None:
        """Take what a message says of a moment."""
        for track, sample in ((self._attitudes, attitude), (self._positions, position)):
            if sample is not None:
                track.add(stamp, sample)

    def repeat_from(self, stamp: int) -> None:
        """Give no pose of the times from a stamp on that may come twice."""
        self._repeated.append((stamp, self.newest + self._maximum_gap))

    def at(self, stamp: int) -> tuple[Pose, Motion]:
        """Pose of `base_link` in `map` at a stamp, and how it moved then.

        Raises
        ------
        PoseAwaitedError
            A sample from after the stamp is still to come.
        PoseError
            The stamp is older than all samples, or lies in a gap, across a reset, or in a time
            that has come twice.
        """
        if any(first <= stamp <= last for first, last in self._repeated):
            raise PoseError('a clock stepped back around that time', 'clock stepped')
        before, after, turning_gap, weight = self._attitudes.around(stamp, self._maximum_gap)
        start, end, moving_gap, along = self._positions.around(stamp, self._maximum_gap)
        rotation = Rotation.from_quat(before.value)
        if weight:
            rotation *= Rotation.from_rotvec(weight * _turn(after.value, before.value))
        motion = Motion(
            velocity=(start if along <= 0.5 else end).rate,
            turn_rate=rotation.apply((before if weight <= 0.5 else after).rate),
            gap=max(turning_gap, moving_gap),
            is_of_sample=end.resets is not None,
            covariance=end.covariance,
        )
        return Pose(rotation, start.value + along * (end.value - start.value)), motion

    @property
    def resets(self) -> int:
        """How often the estimator was reset."""
        return self._attitudes.resets + self._positions.resets

    @property
    def newest(self) -> int:
        """Stamp of the newest sample, or 0."""
        return max(self._attitudes.stamps[-1:] + self._positions.stamps[-1:], default=0)

    def fresh(self) -> list[int]:
        """Stamps of attitudes that lie within the known positions and were not given before."""
        stamps, positions = self._attitudes.stamps, self._positions.stamps
        if not positions:
            return []
        begin = max(
            bisect.bisect_right(stamps, self._given), bisect.bisect_left(stamps, positions[0])
        )
        found = stamps[begin : bisect.bisect_right(stamps, positions[-1])]
        self._given = max([self._given, *found[-1:]])
        return found


def _turn(end: _Vector, start: _Vector) -> _Vector:
    """Rotation vector, in the body's frame, to one quaternion (x, y, z, w) from another."""
    return (Rotation.from_quat(start).inv() * Rotation.from_quat(end)).as_rotvec()


def _ms(nanoseconds: float) -> str:
    return f'{nanoseconds / 1e6:.0f} ms'


def samples(message: Any) -> tuple[Sample | None, Sample | None]:
    """Attitude and position of an ATTITUDE_QUATERNION, LOCAL_POSITION_NED or ODOMETRY.

    None of either that it does not bring, and of both if one is impossible: not finite, no
    rotation, or not in a frame that knows north.
    """
    name = message.get_type()
    turn = None if name == 'LOCAL_POSITION_NED' else _attitude(message)
    place = None if name == 'ATTITUDE_QUATERNION' else _position(message)
    if name != 'ODOMETRY':
        return turn, place
    is_in_map = message.child_frame_id == mavlink.MAV_FRAME_LOCAL_NED
    is_in_body = message.child_frame_id == mavlink.MAV_FRAME_BODY_FRD
    is_known = message.frame_id == mavlink.MAV_FRAME_LOCAL_NED and (is_in_map or is_in_body)
    if turn is None or place is None or not is_known:
        return None, None
    if is_in_body:
        velocity = frames.flu_from_frd((message.vx, message.vy, message.vz))
        place = place._replace(rate=Rotation.from_quat(turn.value).apply(velocity))
    covariance = pose_covariance.of_odometry(message.pose_covariance)
    turn = turn._replace(resets=message.reset_counter)
    return turn, place._replace(resets=message.reset_counter, covariance=covariance)


def _attitude(message: Any) -> Sample | None:
    is_odometry = message.get_type() == 'ODOMETRY'
    quaternion = message.q if is_odometry else (message.q1, message.q2, message.q3, message.q4)
    rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
    is_finite = all(map(math.isfinite, (*quaternion, *rates)))
    if not is_finite or abs(math.hypot(*quaternion) - 1) > 0.01:
        return None
    return Sample(frames.enu_attitude(quaternion), frames.flu_from_frd(rates))


def _position(message: Any) -> Sample | None:
    place, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
    if not all(map(math.isfinite, (*place, *velocity))):
        return None
    return Sample(frames.enu_from_ned(place), frames.enu_from_ned(velocity))
