"""Where on the earth the map's origin is.

GPS_GLOBAL_ORIGIN says it. Where an autopilot does not send that, or to see that it is true,
GLOBAL_POSITION_INT and the position in the map at the same time say it too. Both give heights
above the mean sea; GPS_RAW_INT says how far the WGS 84 ellipsoid is from there.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.autopilot.vehicle_state import Instant
from ftp_dent_ros.navigation.time_and_place.clock_offset import ClockOffset
from ftp_dent_ros.navigation.time_and_place.geodesy import Origin, origin_below, place_on_earth
from ftp_dent_ros.pose import Pose

# Seconds from asking for what is missing to asking again.
_ASK_AGAIN = 3.0
# The same where it is only to be seen whether the origin moves.
_ASK_SELDOM = 30.0
_ONCE = (mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT)


class Earth:
    """Follows the origin of one autopilot's map.

    Parameters
    ----------
    clock : ClockOffset
    pose_at : callable
        Pose in the map at a time since boot.
    """

    def __init__(self, clock: ClockOffset, pose_at: Callable[[int], Pose]) -> None:
        self._clock, self._pose_at = clock, pose_at
        self.handlers = {
            'GPS_GLOBAL_ORIGIN': self._on_gps_global_origin,
            'GLOBAL_POSITION_INT': self._on_global_position_int,
            'GPS_RAW_INT': self._on_gps_raw_int,
        }
        self.clear()

    def clear(self) -> None:
        """Forget everything: the autopilot has just been found, or has rebooted."""
        self._said: Origin | None = None
        self._derived: Origin | None = None
        self._passed: tuple[int, Origin] | None = None
        self._separation: float | None = None
        self._asked = [-math.inf, -math.inf]

    @property
    def origin(self) -> Origin | None:
        """The map's origin, if it is known."""
        origin = self._said or self._derived
        if origin is None or self._separation is None:
            return origin
        return replace(origin, altitude=origin.above_sea + self._separation)

    @property
    def error(self) -> float | None:
        """How far apart the two ways to know it are, metres."""
        if self._said is None or self._derived is None:
            return None
        return self._said.distance(self._derived)

    def next_request(self, now: float, height: bool = True) -> int | None:
        """Number of a message to request once, at a steady time.

        Without `height` it is only the origin's, and seldom.
        """
        known = (self._said is not None, self._separation is not None or not height)
        period = _ASK_AGAIN if height else _ASK_SELDOM
        for index, message_id in enumerate(_ONCE):
            if not known[index] and now - self._asked[index] > period:
                self._asked[index] = now
                return message_id
        return None

    def _on_gps_global_origin(self, message: Any, at: Instant) -> None:
        said = place_on_earth(message.latitude, message.longitude, message.altitude)
        self._said = said or self._said

    def _on_global_position_int(self, message: Any, at: Instant) -> None:
        # By now there are samples on both sides of the one before.
        if self._passed is not None:
            boot, place = self._passed
            with contextlib.suppress(PoseError):
                self._derived = origin_below(place, self._pose_at(boot).translation)
        here = place_on_earth(message.lat, message.lon, message.alt)
        stamp = self._clock.unwrap(message.time_boot_ms, at.ros)
        self._passed = None if here is None or stamp is None else (stamp, here)

    def _on_gps_raw_int(self, message: Any, at: Instant) -> None:
        if message.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX and message.alt_ellipsoid:
            self._separation = 1e-3 * (message.alt_ellipsoid - message.alt)
