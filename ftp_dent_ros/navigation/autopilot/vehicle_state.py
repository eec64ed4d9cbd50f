"""What goes into a vehicle and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ftp_dent_ros.navigation.poses.gps import GpsState
from ftp_dent_ros.navigation.time_and_place.clock_offset import ClockState
from ftp_dent_ros.navigation.time_and_place.geodesy import Origin

# An autopilot heartbeats at 1 Hz whatever else it sends; diagnostics tell it a second later.
SILENCE = 1.5


@dataclass(frozen=True)
class Instant:
    """One moment on both clocks: ROS time in nanoseconds, steady time in seconds."""

    ros: int
    steady: float


@dataclass(frozen=True)
class Settings:
    """Whom to believe and what to ask for.

    Attributes
    ----------
    system_id : int
        MAVLink system to believe; 0 is that of the first autopilot heard.
    component_id : int
        Component to believe in it.
    rate : float
        Rate of attitude and position, Hz.
    maximum_gap : float
        Longest time between two samples that is interpolated across, seconds.
    maximum_clock_error : float
        Largest uncertainty of the autopilot's clock at which poses are given, seconds.
    earth : bool
        Whether to ask for all that tells where on the earth the map's origin is.
    position_source : {'gps', 'other'}
        Whether GPS is watched: without new and good fixes there is no pose then.
    height_scale_uncertainty : float
        Standard deviation of height as a share of the height above the map's origin.
    """

    system_id: int = 0
    component_id: int = 1
    rate: float = 50.0
    maximum_gap: float = 0.15
    maximum_clock_error: float = 0.01
    earth: bool = False
    position_source: Literal['gps', 'other'] = 'gps'
    height_scale_uncertainty: float = 0.04


@dataclass(frozen=True)
class VehicleState:
    """State for those who watch; counts are since the start, times in seconds, rates in Hz.

    Attributes
    ----------
    silence : float or None
        Time since the autopilot was last heard.
    estimator : str
        As `Estimator.state`.
    estimator_fault : str
        What is wrong with it by its latest report, '' if nothing is.
    gps : GpsState or None
        None if the vehicle does not navigate by GPS.
    above_ground : float or None
        Distance to what a range finder sees below, metres.
    utc_error : float or None
        How far this computer's clock is ahead of the autopilot's UTC (of GPS), if it has one.
    rates : dict
        Rates measured, by the messages' names.
    slow, denied : list
        Names of the required messages that come too slowly, and that are denied.
    rerated : int
        How often somebody else changed the rate of a message that is wanted.
    rerated_by : str
        Who was last seen to, if that was of late; 'another client' if nobody was seen.
    foreign, malformed, lost : int
        Messages of others; of the autopilot's own with impossible contents; that never came.
    resets : int
        Jumps of the estimator.
    pose_age : float or None
        Age of the newest sample of a pose.
    origin : Origin or None
        Where on the earth the map's origin is, if that was asked and is known.
    origin_error : float or None
        How far apart two ways to know it are, metres.
    """

    identity: tuple[int, int] | None
    autopilot: str
    silence: float | None
    estimator: str
    clock: ClockState
    utc_error: float | None
    rates: dict[str, float]
    slow: list[str]
    denied: list[str]
    messages: int
    foreign: int
    malformed: int
    lost: int
    resets: int
    estimator_fault: str = ''
    gps: GpsState | None = None
    above_ground: float | None = None
    rerated: int = 0
    rerated_by: str = ''
    pose_age: float | None = None
    origin: Origin | None = None
    origin_error: float | None = None

    @property
    def is_alive(self) -> bool:
        """Whether the autopilot has been heard of late."""
        return self.silence is not None and self.silence < SILENCE
