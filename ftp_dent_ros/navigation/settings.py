"""What a vehicle is asked with: whom to believe, what to ask for, and a moment on both clocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: The largest maximum_clock_error, seconds: at 1 m/s it costs a metre.
MOST_CLOCK_ERROR = 1.0


@dataclass(frozen=True)
class Instant:
    """One moment on both clocks: ROS time in nanoseconds, steady time in seconds."""

    ros: int
    steady: float


@dataclass(frozen=True)
class VehicleSettings:
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
    position_source: Literal['gps', 'other'] = 'gps'
    height_scale_uncertainty: float = 0.04
