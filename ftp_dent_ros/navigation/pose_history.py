"""Poses out of the autopilot's messages, kept for a while and interpolated."""

from __future__ import annotations

import bisect
import math
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
    is_reset : bool
        Whether the estimator was reset since the sample before.
    is_of_sample, covariance
        As of `Motion`.
    """

    value: _Vector
    rate: _Vector
    is_reset: bool = False
    is_of_sample: bool = False
    covariance: Covariance | None = None


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

    def clear(self) -> None:
        """Forget everything: the stamps start anew."""
        self.stamps, self.samples = [], []

    def add(self, stamp: int, sample: Sample) -> None:
        """Take a sample, unless it is not newer than the last."""
        if self.stamps and stamp <= self.stamps[-1]:
            return
        if self.stamps and not sample.is_reset:
            seconds, last = (stamp - self.stamps[-1]) / 1e9, self.samples[-1]
            off = self.step(last.value, sample.value) - (last.rate + sample.rate) / 2 * seconds
            most = self.jump + self.acceleration * seconds**2 / 4
            sample = sample._replace(is_reset=bool(np.linalg.norm(off) > most))
        self.resets += sample.is_reset
        self.stamps.append(stamp)
        self.samples.append(sample)
        expired = bisect.bisect_left(self.stamps, stamp - self.duration)
        if expired > len(self.stamps) // 2:
            del self.stamps[:expired], self.samples[:expired]

    def around(self, stamp: int, maximum_gap: int) -> tuple[Sample, Sample, float, float]:
        """The samples around a stamp, their gap in seconds, and where in it it lies, 0 to 1."""
        if not self.stamps:
            raise PoseAwaitedError(f'no {self.name} has come from the autopilot', 'no pose yet')
        if stamp > self.stamps[-1]:
            raise PoseAwaitedError(
                f'the newest {self.name} is {_ms(stamp - self.stamps[-1])} older than the stamp',
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
        self.attitudes = Track('attitude', kept, _turn, _ROTATION_JUMP, 10.0)
        self.positions = Track('position', kept, _shift, _POSITION_JUMP, 20.0)

    def at(self, stamp: int) -> tuple[Pose, Motion]:
        """Pose of `base_link` in `map` at a stamp, and how it moved then.

        Raises
        ------
        PoseAwaitedError
            A sample from after the stamp is still to come.
        PoseError
            The stamp is older than all samples, or lies in a gap or across a reset.
        """
        before, after, turning_gap, weight = self.attitudes.around(stamp, self._maximum_gap)
        start, end, moving_gap, along = self.positions.around(stamp, self._maximum_gap)
        rotation = Rotation.from_quat(before.value)
        if weight:
            rotation *= Rotation.from_rotvec(weight * _turn(before.value, after.value))
        body_rate = (before if weight <= 0.5 else after).rate
        velocity = (start if along <= 0.5 else end).rate
        gap = max(turning_gap, moving_gap)
        turn_rate = rotation.apply(body_rate)
        motion = Motion(velocity, turn_rate, gap, end.is_of_sample, end.covariance)
        return Pose(rotation, start.value + along * (end.value - start.value)), motion

    @property
    def resets(self) -> int:
        """How often the estimator was reset."""
        return self.attitudes.resets + self.positions.resets

    @property
    def newest(self) -> int:
        """Stamp of the newest sample, or 0."""
        return max(self.attitudes.stamps[-1:] + self.positions.stamps[-1:], default=0)

    def stamps_since(self, stamp: int) -> list[int]:
        """Stamps of attitudes later than `stamp` that lie within the known positions."""
        stamps, positions = self.attitudes.stamps, self.positions.stamps
        if not positions:
            return []
        begin = max(bisect.bisect_right(stamps, stamp), bisect.bisect_left(stamps, positions[0]))
        return stamps[begin : bisect.bisect_right(stamps, positions[-1])]


def _shift(start: _Vector, end: _Vector) -> _Vector:
    return end - start


def _turn(start: _Vector, end: _Vector) -> _Vector:
    """Rotation vector, in the body's frame, from one quaternion (x, y, z, w) to another."""
    return (Rotation.from_quat(start).inv() * Rotation.from_quat(end)).as_rotvec()


def _ms(nanoseconds: float) -> str:
    return f'{nanoseconds / 1e6:.0f} ms'


def attitude(message: Any) -> Sample | None:
    """Sample of an ATTITUDE_QUATERNION or ODOMETRY.

    None if it is impossible: not finite, or no rotation.
    """
    is_odometry = message.get_type() == 'ODOMETRY'
    quaternion = message.q if is_odometry else (message.q1, message.q2, message.q3, message.q4)
    rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
    is_finite = all(map(math.isfinite, (*quaternion, *rates)))
    if not is_finite or abs(math.hypot(*quaternion) - 1) > 0.01:
        return None
    return Sample(frames.enu_attitude(quaternion), frames.flu_from_frd(rates))


def position(message: Any) -> Sample | None:
    """Sample of a LOCAL_POSITION_NED; None if it is not finite."""
    place, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
    if not all(map(math.isfinite, (*place, *velocity))):
        return None
    return Sample(frames.enu_from_ned(place), frames.enu_from_ned(velocity))


def odometry(message: Any) -> tuple[Sample, Sample] | None:
    """Samples of attitude and position of an ODOMETRY.

    None if it is impossible, or not in a frame that knows north; no covariance if it says none.
    """
    turn, place = attitude(message), position(message)
    if message.frame_id != mavlink.MAV_FRAME_LOCAL_NED or turn is None or place is None:
        return None
    if message.child_frame_id == mavlink.MAV_FRAME_BODY_FRD:
        velocity = frames.flu_from_frd((message.vx, message.vy, message.vz))
        place = place._replace(rate=Rotation.from_quat(turn.value).apply(velocity))
    elif message.child_frame_id != mavlink.MAV_FRAME_LOCAL_NED:
        return None
    covariance = pose_covariance.of_odometry(message.pose_covariance)
    return turn, place._replace(is_of_sample=True, covariance=covariance)
