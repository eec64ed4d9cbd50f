"""A simulated flight, and how an autopilot's estimate of it is off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.fields import Checked, Limits, NotNegative, Positive, Triple
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
_PHASES = np.array(
    [
        [0.3, 1.9, 4.1],
        [2.2, 5.3, 0.7],
        [4.4, 0.2, 3.0],
        [1.1, 3.7, 5.9],
        [5.0, 2.6, 1.3],
        [3.3, 4.8, 2.1],
    ]
)
# Of the differences that rates are: seconds, in which a sway of 0.4 Hz is a line to 1e-6.
_STEP = 1e-3

Vector = NDArray[np.float64]

# The wander: periods by the slowest one's, shares, and phases of east, north, up and heading. No
# two quantities reach their largest at once, or ever again in step.
_PERIODS = np.array([1.0, 0.41, 0.17])
_ESTIMATE_PHASES = np.array([[0.4, 2.1, 5.2], [3.7, 0.9, 1.6], [5.1, 4.4, 2.8], [1.9, 5.8, 0.3]])


@dataclass(frozen=True, eq=False)
class Flight(Checked):
    """There and back along a track, with sway and wobble.

    Attributes
    ----------
    middle : Pose
        Pose of ``base_link`` in ``map`` halfway along the track, undisturbed.
    length : float
        Of the track, metres; it runs along ``base_link``'s y axis (left), first to the left.
    speed : float
        Mean speed along the track, m/s.
    sway : tuple of 3 floats
        Largest deviation along ``base_link``'s x, y, z, metres.
    wobble : tuple of 3 floats
        Largest roll, pitch and yaw about the undisturbed attitude, radians.

    Raises
    ------
    ConfigurationError
        A value is out of its range.
    """

    middle: Pose
    length: Positive
    speed: Positive
    sway: Annotated[Triple, Limits(0)] = (0.0, 0.0, 0.0)
    wobble: Annotated[Triple, Limits(0, 1)] = (0.0, 0.0, 0.0)

    @property
    def period_ns(self) -> int:
        """Time for the way there and back, nanoseconds."""
        return round(2e9 * self.length / self.speed)

    def pose(self, seconds: float) -> Pose:
        """Pose of ``base_link`` (FLU) in ``map`` (ENU) so long after the start."""
        period = self.period_ns / 1e9
        circle = 2 * math.pi / period
        whole = np.maximum(np.rint(_FREQUENCIES * period), 1)
        amplitude = np.concatenate([self.sway, self.wobble])[:, None] * _SHARES
        deviation = np.sum(amplitude * np.sin(circle * whole * seconds + _PHASES), axis=1)
        deviation[1] -= self.length / 2 * (_TURN_SHARES @ np.cos(circle * _TURNS * seconds))
        return self.middle @ Pose.from_rpy(deviation[3:], deviation[:3])

    def rates(self, seconds: float) -> tuple[Vector, Vector]:
        """Velocity in ``map``, m/s, and angular velocity in ``base_link``, rad/s, shape (3,)."""
        before, after = self.pose(seconds - _STEP), self.pose(seconds + _STEP)
        turn = (before.rotation.inv() * after.rotation).as_rotvec()
        return (after.translation - before.translation) / (2 * _STEP), turn / (2 * _STEP)


@dataclass(frozen=True)
class EstimateErrors(Checked):
    """How the autopilot's estimate is off; metres, seconds, radians.

    Attributes
    ----------
    offset : tuple of 3 floats
        East, north, up.
    wander : tuple of 3 floats
        Largest deviation from it; its root mean square is 0.48 times as much.
    wander_period : float
        Of the slowest part of every wander.
    lag : float
        How late the position is.
    yaw, yaw_wander : float
        Heading, counterclockwise from above.
    height_scale : float
        Share by which every height above the origin is too high.
    """

    offset: Triple = (0.0, 0.0, 0.0)
    wander: Triple = (0.0, 0.0, 0.0)
    wander_period: Positive = 60.0
    lag: float = 0.0
    yaw: float = 0.0
    yaw_wander: float = 0.0
    height_scale: float = 0.0

    def estimated(self, flight: Flight, seconds: float, elapsed: float) -> Pose:
        """The pose that is estimated so long into a flight.

        Parameters
        ----------
        flight : Flight
        seconds : float
            Into the flight's period.
        elapsed : float
            Since the flight's start; the wander does not begin again with each period.
        """
        true = flight.pose(seconds)
        angle = 2 * math.pi / self.wander_period * elapsed / _PERIODS + _ESTIMATE_PHASES
        east, north, up, turn = np.sin(angle) @ _SHARES
        place = flight.pose(seconds - self.lag).translation if self.lag else true.translation
        place = place * [1, 1, 1 + self.height_scale] + self.offset
        heading = Rotation.from_euler('z', self.yaw + self.yaw_wander * turn)
        return Pose(heading * true.rotation, place + np.array(self.wander) * [east, north, up])


@dataclass(frozen=True)
class Faults(Checked):
    """What goes wrong, and when; seconds since the autopilot was started, 0 for never.

    Attributes
    ----------
    gps_lost_from, gps_lost_for : float
        Without GPS the estimate drifts off, its test ratios stand still, and for 7 s it says that
        it is ready.
    """

    gps_lost_from: NotNegative = 0.0
    gps_lost_for: NotNegative = 0.0

    def without_gps(self, uptime: float) -> float:
        """For how long there has been no GPS, seconds; 0 while there is."""
        since = uptime - self.gps_lost_from
        return since if self.gps_lost_from and 0 <= since < self.gps_lost_for else 0.0

    def drift(self, uptime: float) -> NDArray[np.float64]:
        """How far the estimate has drifted off, shape (3,), metres."""
        # What is left of the inertial sensors' errors without GPS, m/s2: a metre in seven seconds.
        off = 0.04 * self.without_gps(uptime) ** 2 / 2
        return np.array([0.8 * off, -0.6 * off, 0.0])
