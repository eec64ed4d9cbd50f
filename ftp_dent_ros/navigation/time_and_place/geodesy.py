"""Places on the earth, near enough to each other for it to be flat; WGS 84."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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


def origin_below(place: Origin, position: NDArray) -> Origin:
    """Origin of a map in which a place on the earth has a position (ENU, metres)."""
    return place.moved(-position)


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
