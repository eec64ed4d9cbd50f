"""Where on the earth the map's origin is (WGS 84), by what the autopilot says."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.settings import Instant

# Equatorial radius in metres, and the eccentricity's square.
_RADIUS, _ECCENTRICITY = 6_378_137.0, 6.694_379_990_141e-3


@dataclass(frozen=True)
class Origin:
    """The map's origin.

    Attributes
    ----------
    latitude, longitude : float
        WGS 84, degrees.
    above_sea : float
        Metres above the mean sea.
    altitude : float
        Metres above the ellipsoid; NaN if that is not known.
    """

    latitude: float
    longitude: float
    above_sea: float
    altitude: float = math.nan

    def distance(self, other: Origin) -> float:
        """Horizontal distance to another that is near by, metres."""
        return float(np.hypot(*self.offset_of(other)[:2]))

    def offset_of(self, other: Origin) -> NDArray[np.float64]:
        """Where another that is near by lies from here (ENU, metres)."""
        north, east = _metres_per_degree(self.latitude)
        return np.array(
            [
                east * (other.longitude - self.longitude),
                north * (other.latitude - self.latitude),
                other.above_sea - self.above_sea,
            ]
        )

    def moved(self, offset: NDArray) -> Origin:
        """The place that lies at an offset (ENU, metres) from here."""
        east, north, up = (float(value) for value in offset)
        per_latitude, per_longitude = _metres_per_degree(self.latitude)
        return Origin(
            self.latitude + north / per_latitude,
            self.longitude + east / per_longitude,
            self.above_sea + up,
            self.altitude + up,
        )


def place_on_earth(latitude: int, longitude: int, altitude: int) -> Origin | None:
    """Place of MAVLink's 1e-7 degrees and millimetres; None for none (0, 0) and no such place."""
    if not (latitude or longitude) or abs(latitude) > 900_000_000 or abs(longitude) > 1.8e9:
        return None
    return Origin(1e-7 * latitude, 1e-7 * longitude, 1e-3 * altitude)


def _metres_per_degree(latitude: float) -> tuple[float, float]:
    """Of latitude and of longitude, by the ellipsoid's radii of curvature."""
    phi = math.radians(latitude)
    curve = 1 - _ECCENTRICITY * math.sin(phi) ** 2
    meridian = _RADIUS * (1 - _ECCENTRICITY) / curve**1.5
    parallel = _RADIUS / math.sqrt(curve) * math.cos(phi)
    return math.radians(meridian), math.radians(parallel)


class Earth:
    """Follows the origin of one autopilot's map."""

    def __init__(self) -> None:
        self.handlers: dict[str, Callable[[Any, Instant], None]] = {
            'GPS_GLOBAL_ORIGIN': self._on_gps_global_origin,
            'GPS_RAW_INT': self._on_gps_raw_int,
        }
        self._reported: Origin | None = None
        self._separation = math.nan
        self._asked = -math.inf

    @property
    def origin(self) -> Origin | None:
        """The map's origin, if it is known."""
        origin = self._reported
        return origin and replace(origin, altitude=origin.above_sea + self._separation)

    def figures(self) -> dict[str, str]:
        """What is known of it."""
        origin = self._reported
        if origin is None:
            return {}
        return {
            'origin (deg)': f'{origin.latitude:.7f} {origin.longitude:.7f}',
            'origin above the sea (m)': f'{origin.above_sea:.2f}',
        }

    def is_due(self, now: float) -> bool:
        """Whether to ask for it at a steady time: every 3 s until it has come."""
        is_due = self._reported is None and now - self._asked > 3.0
        self._asked = now if is_due else self._asked
        return is_due

    def _on_gps_global_origin(self, message: Any, at: Instant) -> None:
        place = place_on_earth(message.latitude, message.longitude, message.altitude)
        self._reported = place or self._reported

    def _on_gps_raw_int(self, message: Any, at: Instant) -> None:
        if message.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX and message.alt_ellipsoid:
            self._separation = 1e-3 * (message.alt_ellipsoid - message.alt)
