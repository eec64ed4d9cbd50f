"""A drone's flight along a panel: a smooth, periodic function of time.

Everything is a sum of sines whose frequencies are whole multiples of one over the period, so
that position, velocity and body rates are exact at any time and the flight goes on for ever.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose

# Fourier series of a triangle, cut off: there and back at an almost constant speed.
_TURNS = np.array([1, 3, 5])
_TURN_SHARES = 1 / _TURNS**2 / np.sum(1 / _TURNS**2)
# Sway x, y, z and wobble roll, pitch, yaw: frequencies (Hz), shares and phases (radians) of what
# a multirotor does about its set point. No two axes have the same, so that all of them mix.
_FREQUENCIES = np.array(
    [
        [0.061, 0.143, 0.317],
        [0.053, 0.127, 0.283],
        [0.071, 0.167, 0.349],
        [0.097, 0.229, 0.431],
        [0.083, 0.211, 0.389],
        [0.047, 0.109, 0.257],
    ]
)
_SHARES = np.array([0.6, 0.3, 0.1])
_PHASES = np.array([[0.3, 1.9, 4.1], [2.2, 5.3, 0.7], [4.4, 0.2, 3.0], [1.1, 3.7, 5.9]])
_PHASES = np.vstack([_PHASES, [[5.0, 2.6, 1.3], [3.3, 4.8, 2.1]]])

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Flight:
    """There and back along a track, with sway and wobble.

    Attributes
    ----------
    middle : Pose
        Pose of ``base_link`` in ``map`` halfway along the track, undisturbed.
    length : float
        Of the track, metres; it runs along ``base_link``'s y axis (left), first to the left.
    speed : float
        Mean speed along the track, m/s.
    sway : ndarray, shape (3,)
        Largest deviation along ``base_link``'s x, y, z, metres.
    wobble : ndarray, shape (3,)
        Largest roll, pitch and yaw about the undisturbed attitude, radians.

    Raises
    ------
    ConfigurationError
        A value is out of its range.
    """

    middle: Pose
    length: float
    speed: float
    sway: Vector
    wobble: Vector

    def __post_init__(self) -> None:
        for name in ('length', 'speed'):
            if not getattr(self, name) > 0:
                raise ConfigurationError(
                    f'flight: {name} is {getattr(self, name)!r}: give a positive number'
                )
        if (self.sway < 0).any() or (self.wobble < 0).any() or (self.wobble > 1).any():
            raise ConfigurationError(
                'flight: sway and wobble are largest deviations: give none below 0, '
                'and no angle above 1 radian'
            )

    @property
    def period_ns(self) -> int:
        """Time for the way there and back, nanoseconds."""
        return round(2e9 * self.length / self.speed)

    def pose(self, seconds: float) -> Pose:
        """Pose of ``base_link`` (FLU) in ``map`` (ENU) so long after the start."""
        offset, rpy, _, _ = self._deviation(seconds)
        return self.middle @ Pose.from_rpy(rpy, offset)

    def velocity(self, seconds: float) -> Vector:
        """Velocity of ``base_link`` in ``map``, shape (3,), m/s."""
        _, _, offset_rate, _ = self._deviation(seconds)
        return self.middle.rotation.apply(offset_rate)

    def body_rates(self, seconds: float) -> Vector:
        """Angular velocity in ``base_link``'s axes, shape (3,), rad/s."""
        _, (roll, pitch, _), _, (roll_rate, pitch_rate, yaw_rate) = self._deviation(seconds)
        # The columns of Euler's kinematic matrix for the order yaw, pitch, roll.
        about_pitch = np.array([0, math.cos(roll), -math.sin(roll)])
        about_yaw = np.array(
            [
                -math.sin(pitch),
                math.sin(roll) * math.cos(pitch),
                math.cos(roll) * math.cos(pitch),
            ]
        )
        return np.array([roll_rate, 0, 0]) + pitch_rate * about_pitch + yaw_rate * about_yaw

    def _deviation(self, seconds: float) -> tuple[Vector, Vector, Vector, Vector]:
        """Offset and roll, pitch, yaw from `middle`, and their rates, each of shape (3,)."""
        period = self.period_ns / 1e9
        circle = 2 * math.pi / period
        whole = np.maximum(np.rint(_FREQUENCIES * period), 1)
        angle = circle * whole * seconds + _PHASES
        amplitude = np.concatenate([self.sway, self.wobble])[:, None] * _SHARES
        value = np.sum(amplitude * np.sin(angle), axis=1)
        rate = np.sum(amplitude * circle * whole * np.cos(angle), axis=1)
        turn = circle * _TURNS * seconds
        value[1] -= self.length / 2 * (_TURN_SHARES @ np.cos(turn))
        rate[1] += self.length / 2 * circle * ((_TURN_SHARES * _TURNS) @ np.sin(turn))
        return value[:3], value[3:], rate[:3], rate[3:]
