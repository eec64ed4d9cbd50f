"""Poses out of the autopilot's messages, kept for a while and interpolated."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
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

# A sample of one quantity: its value and its rate of change; a kept one also has whether its stamp
# is that of the sample, and the covariance that came with it.
Sample = tuple[_Vector, _Vector]
_Kept = tuple[_Vector, _Vector, bool, Covariance | None]

_BODY = mavlink.MAV_FRAME_BODY_FRD


@dataclass
class _Track:
    """Samples of one quantity and its rate of change, in the order of their stamps.

    A sample that lies further from where its neighbour was heading than `jump` is no motion but
    a reset of the estimator; samples far apart may also have been accelerated.
    """

    name: str
    duration: int
    step: Callable[[_Vector, _Vector], _Vector]
    jump: float
    acceleration: float
    stamps: list[int] = field(default_factory=list)
    samples: list[_Kept] = field(default_factory=list)
    is_reset: list[bool] = field(default_factory=list)

    def clear(self) -> None:
        self.stamps, self.samples, self.is_reset = [], [], []

    def add(self, stamp: int, sample: _Kept, jumped: bool) -> None:
        if self.stamps and not jumped:
            seconds = (stamp - self.stamps[-1]) / 1e9
            (last, last_rate, *_), (value, rate, *_) = self.samples[-1], sample
            off = self.step(last, value) - (last_rate + rate) / 2 * seconds
            jumped = bool(np.linalg.norm(off) > self.jump + self.acceleration * seconds**2 / 4)
        self.stamps.append(stamp)
        self.samples.append(sample)
        self.is_reset.append(jumped)
        expired = bisect.bisect_left(self.stamps, stamp - self.duration)
        if expired > len(self.stamps) // 2:
            del self.stamps[:expired], self.samples[:expired], self.is_reset[:expired]

    def around(self, stamp: int, maximum_gap: int) -> tuple[_Kept, _Kept, float, float]:
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
        after = bisect.bisect_left(self.stamps, stamp)
        if self.stamps[after] == stamp:
            return self.samples[after], self.samples[after], 0.0, 0.0
        gap = self.stamps[after] - self.stamps[after - 1]
        if self.is_reset[after]:
            raise PoseError(
                f"the estimator's {self.name} jumped at the time of the stamp", 'estimator reset'
            )
        if gap > maximum_gap:
            raise PoseError(
                f'no {self.name} came for {_ms(gap)} around the stamp, more than '
                f'{_ms(maximum_gap)}',
                'gap in the samples',
            )
        share = (stamp - self.stamps[after - 1]) / gap
        return self.samples[after - 1], self.samples[after], gap / 1e9, share


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
        self._attitudes = _Track('attitude', kept, _turn, _ROTATION_JUMP, 10.0)
        self._positions = _Track('position', kept, _difference, _POSITION_JUMP, 20.0)
        self.resets = 0

    def add_attitude(
        self, stamp: int, quaternion: ArrayLike, body_rate: ArrayLike, is_reset: bool = False
    ) -> bool:
        """Take an attitude (x, y, z, w; FLU -> ENU) and its body rates (FLU, rad/s).

        `is_reset` says that the estimator was reset since the one before.

        Returns
        -------
        bool
            Whether it was taken; one that is not newer than the last is not.
        """
        sample = np.asarray(quaternion, float), np.asarray(body_rate, float)
        return self._add(self._attitudes, stamp, (*sample, False, None), is_reset)

    def add_position(
        self,
        stamp: int,
        position: ArrayLike,
        velocity: ArrayLike,
        is_reset: bool = False,
        is_of_sample: bool = False,
        covariance: Covariance | None = None,
    ) -> bool:
        """Take a position (metres) and velocity (m/s) in `map`; as `add_attitude`.

        `is_of_sample` and `covariance` are those of `Motion`.
        """
        sample = np.asarray(position, float), np.asarray(velocity, float)
        return self._add(self._positions, stamp, (*sample, is_of_sample, covariance), is_reset)

    def clear(self) -> None:
        """Forget everything: the stamps start anew."""
        self._attitudes.clear()
        self._positions.clear()

    def at(self, stamp: int) -> tuple[Pose, Motion]:
        """Pose of `base_link` in `map` at a stamp, and how it moved then.

        Raises
        ------
        PoseAwaitedError
            A sample from after the stamp is still to come.
        PoseError
            The stamp is older than all samples, or lies in a gap or across a reset.
        """
        before, after, turning_gap, weight = self._attitudes.around(stamp, self._maximum_gap)
        start, end, moving_gap, along = self._positions.around(stamp, self._maximum_gap)
        rotation = Rotation.from_quat(before[0])
        if weight:
            rotation = rotation * Rotation.from_rotvec(weight * _turn(before[0], after[0]))
        body_rate = (before if weight <= 0.5 else after)[1]
        velocity = (start if along <= 0.5 else end)[1]
        gap = max(turning_gap, moving_gap)
        motion = Motion(velocity, rotation.apply(body_rate), gap, *end[2:])
        return Pose(rotation, start[0] + along * (end[0] - start[0])), motion

    @property
    def newest(self) -> int:
        """Stamp of the newest sample, or 0."""
        return max(self._attitudes.stamps[-1:] + self._positions.stamps[-1:], default=0)

    def stamps_since(self, stamp: int) -> list[int]:
        """Stamps of attitudes later than `stamp` that lie within the known positions."""
        stamps, positions = self._attitudes.stamps, self._positions.stamps
        if not positions:
            return []
        begin = max(bisect.bisect_right(stamps, stamp), bisect.bisect_left(stamps, positions[0]))
        return stamps[begin : bisect.bisect_right(stamps, positions[-1])]

    def _add(self, track: _Track, stamp: int, sample: _Kept, is_reset: bool) -> bool:
        if track.stamps and stamp <= track.stamps[-1]:
            return False
        track.add(stamp, sample, is_reset)
        self.resets += track.is_reset[-1]
        return True


def _difference(start: _Vector, end: _Vector) -> _Vector:
    return end - start


def _turn(start: _Vector, end: _Vector) -> _Vector:
    """Rotation vector, in the body's frame, from one quaternion (x, y, z, w) to another."""
    return (Rotation.from_quat(start).inv() * Rotation.from_quat(end)).as_rotvec()


def _ms(nanoseconds: float) -> str:
    return f'{nanoseconds / 1e6:.0f} ms'


def attitude(message: Any) -> Sample | None:
    """Quaternion (x, y, z, w; FLU -> ENU) and body rates (FLU) of an ATTITUDE_QUATERNION.

    None if it is impossible: not finite, or no rotation.
    """
    quaternion = (message.q1, message.q2, message.q3, message.q4)
    return _attitude(quaternion, (message.rollspeed, message.pitchspeed, message.yawspeed))


def position(message: Any) -> Sample | None:
    """Position and velocity in ENU of a LOCAL_POSITION_NED; None if it is not finite."""
    place, velocity = (message.x, message.y, message.z), (message.vx, message.vy, message.vz)
    if not all(map(math.isfinite, (*place, *velocity))):
        return None
    return frames.enu_from_ned(place), frames.enu_from_ned(velocity)


def odometry(message: Any) -> tuple[Sample, Sample, pose_covariance.Covariance | None] | None:
    """Samples as of `attitude` and `position` of an ODOMETRY, and its covariance in the map.

    None if it is impossible, or not in a frame that knows north; no covariance if it says none.
    """
    rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
    turn, place = _attitude(message.q, rates), position(message)
    if message.frame_id != mavlink.MAV_FRAME_LOCAL_NED or turn is None or place is None:
        return None
    if message.child_frame_id == _BODY:
        velocity = (message.vx, message.vy, message.vz)
        place = place[0], Rotation.from_quat(turn[0]).apply(frames.flu_from_frd(velocity))
    elif message.child_frame_id != mavlink.MAV_FRAME_LOCAL_NED:
        return None
    return turn, place, pose_covariance.of_odometry(message.pose_covariance)


def _attitude(quaternion: Any, rates: Any) -> Sample | None:
    is_finite = all(map(math.isfinite, (*quaternion, *rates)))
    if not is_finite or abs(math.hypot(*quaternion) - 1) > 0.01:
        return None
    return frames.enu_attitude(quaternion), frames.flu_from_frd(rates)
