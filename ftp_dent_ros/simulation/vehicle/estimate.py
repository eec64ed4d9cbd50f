"""How a simulated autopilot errs, and what goes wrong with it.

The errors are those of a real one: a constant offset, a slow wander about it, a position that lags
behind the flight, a heading that is off, a barometer whose scale is. The faults come and go.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.vehicle.flight import Flight

# The wander: periods by the slowest one's, shares, and phases of east, north, up and heading. No
# two quantities reach their largest at once, or ever again in step.
_PERIODS = np.array([1.0, 0.41, 0.17])
_SHARES = np.array([0.6, 0.3, 0.1])
_PHASES = np.array([[0.4, 2.1, 5.2], [3.7, 0.9, 1.6], [5.1, 4.4, 2.8], [1.9, 5.8, 0.3]])
# What is left of the inertial sensors' errors without GPS, m/s2: a metre in seven seconds.
_DRIFT = 0.04


@dataclass(frozen=True)
class EstimateErrors:
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

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wander: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wander_period: float = 60.0
    lag: float = 0.0
    yaw: float = 0.0
    yaw_wander: float = 0.0
    height_scale: float = 0.0

    def __post_init__(self) -> None:
        if not self.wander_period > 0:
            raise ConfigurationError(
                f'errors: wander_period is {self.wander_period!r}: give a positive number'
            )

    def estimated(self, flight: Flight, seconds: float) -> Pose:
        """The pose that is estimated so long into a flight."""
        true = flight.pose(seconds)
        angle = 2 * math.pi / self.wander_period * seconds / _PERIODS + _PHASES
        east, north, up, turn = np.sin(angle) @ _SHARES
        place = flight.pose(seconds - self.lag).translation if self.lag else true.translation
        place = place * [1, 1, 1 + self.height_scale] + self.offset
        heading = Rotation.from_euler('z', self.yaw + self.yaw_wander * turn)
        return Pose(heading * true.rotation, place + np.array(self.wander) * [east, north, up])


@dataclass(frozen=True)
class Faults:
    """What goes wrong, and when; seconds since the autopilot was started, 0 for never.

    Attributes
    ----------
    gps_lost_from, gps_lost_for : float
        Without GPS the estimate drifts off, its test ratios stand still, and for 7 s it says that
        it is ready.
    frozen_from, frozen_for : float
        The test ratios stand still, for no measurement is used.
    rerated_every : float
        Another client slows the poses down, as often.
    triggers_every : float
        The camera is told to shoot, as ArduPilot's driver does: to no system and no component.
    """

    gps_lost_from: float = 0.0
    gps_lost_for: float = 0.0
    frozen_from: float = 0.0
    frozen_for: float = 0.0
    rerated_every: float = 0.0
    triggers_every: float = 0.0

    def __post_init__(self) -> None:
        if min(self.__dict__.values()) < 0:
            raise ConfigurationError('faults: their times are in seconds: give none below 0')

    def without_gps(self, uptime: float) -> float:
        """For how long there has been no GPS, seconds; 0 while there is."""
        since = uptime - self.gps_lost_from
        return since if self.gps_lost_from and 0 <= since < self.gps_lost_for else 0.0

    def is_frozen(self, uptime: float) -> bool:
        """Whether the test ratios stand still."""
        is_frozen = 0 <= uptime - self.frozen_from < self.frozen_for
        return bool(self.frozen_from and is_frozen) or self.without_gps(uptime) > 0

    def drift(self, uptime: float) -> NDArray[np.float64]:
        """How far the estimate has drifted off, shape (3,), metres."""
        off = _DRIFT * self.without_gps(uptime) ** 2 / 2
        return np.array([0.8 * off, -0.6 * off, 0.0])
