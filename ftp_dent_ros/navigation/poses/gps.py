"""What GPS itself says (GPS_RAW_INT), beside what the estimator makes of it.

An estimator that loses GPS flies on by its inertial sensors for seconds (ArduPilot: 7 s, PX4: 5 s)
and says that it is ready; its position may be a metre off by then. So a moment is believed only
between two fixes that are new and good. PX4 stops sending when GPS does, ArduPilot repeats the
time of the last fix: both are no new fix.

GPS also says how good it is. An error that GPS has had all along is an error of where the map
lies on the earth; what it has become worse by since is one of places in the map. Of two receivers
the first is watched, which GPS_RAW_INT is about.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.poses.witness import Fault, Witness
from ftp_dent_ros.navigation.time_and_place.geodesy import Origin, place_on_earth

# Both autopilots' GPS gives five fixes a second or more, and a link whose rates are not ours to
# set tells one: further apart, seconds, nothing is vouched for.
_LONGEST = 1.5
# What an estimator's acceleration is uncertain by, m/s2: between two fixes it is on its own.
_ADRIFT = 0.1
# What both autopilots ask of GPS before they navigate by it (EK3_GPS_CHECK, EKF2_GPS_CHECK):
# satellites, and metres of horizontal accuracy (ArduPilot; PX4 asks for 3).
_SATELLITES, _ACCURACY = 6, 5.0
_UNKNOWN_SATELLITES = 255
# A fix is some 0.2 s old when it arrives: that much of the way flown is no disagreement; seconds.
_DELAY = 0.3
# Noise of a fix as ArduPilot assumes it where GPS does not say more: EK3_POSNE_M_NSE and
# EK3_ALT_M_NSE, metres; a disagreement is more than three standard deviations.
_LEAST_ACROSS, _LEAST_UP, _SIGMAS = 0.5, 2.0, 3.0
_WHERE_NOT = 'set position_source to other if this vehicle navigates without GPS'


@dataclass(frozen=True)
class GpsState:
    """What GPS said last.

    Attributes
    ----------
    fault : str
        What is wrong with it, '' if nothing is.
    fix : str
        MAVLink's GPS_FIX_TYPE in words.
    satellites : int or None
    across, up : float or None
        Standard deviations that GPS tells, metres.
    age : float
        Since the last new fix, seconds.
    apart_across, apart_up : float or None
        How far the estimator's position is from GPS's, metres.
    """

    fault: str
    fix: str
    satellites: int | None
    across: float | None
    up: float | None
    age: float | None
    apart_across: float | None
    apart_up: float | None


@dataclass(frozen=True)
class Fix:
    """One new fix: what is wrong with it, when it came, what it adds to the estimator's doubt."""

    fault: Fault | None
    now: int
    doubt: tuple[float, float] = (0.0, 0.0)


class Gps:
    """Fixes of the last seconds; times are ROS times of arrival in nanoseconds."""

    def __init__(self) -> None:
        self._fixes: Witness[Fix] = Witness(
            f'a new fix of GPS (GPS_RAW_INT; {_WHERE_NOT})', 'GPS', _LONGEST
        )
        self._clear()

    def restart(self, now: int) -> None:
        """Forget all: the autopilot has just been found, or has rebooted."""
        self._fixes.restart(now)
        self._clear()

    def _clear(self) -> None:
        self._last: Any = None
        self._time_usec = 0
        self._best: float | None = None
        self._estimate: tuple[int, Origin, float] | None = None
        self._apart: NDArray[np.float64] | None = None

    def on_global_position_int(self, message: Any, now: int) -> None:
        """Take where the estimator takes itself to be on the earth."""
        place = place_on_earth(message.lat, message.lon, message.alt)
        speed = 0.01 * float(np.hypot(message.vx, message.vy))
        self._estimate = None if place is None else (now, place, speed)

    def on_gps_raw_int(self, message: Any, now: int) -> None:
        """Take a GPS_RAW_INT that arrived now."""
        self._last = message
        fault = _fault(message)
        is_repeated = message.time_usec != 0 and message.time_usec == self._time_usec
        self._time_usec = message.time_usec
        if fault is None and is_repeated:
            return
        doubt = (0.0, 0.0) if fault else self._doubt(message, now)
        self._fixes.add(Fix(fault, now, doubt), now)

    def check(self, stamp: int, heard: int) -> tuple[float, float]:
        """Standard deviations across and up that GPS adds at a stamp, metres.

        Raises
        ------
        PoseAwaitedError, PoseError
            As of `Witness.around`.
        """
        before, after = self._fixes.around(stamp, heard)
        adrift = _ADRIFT * (1e-9 * (after.now - before.now)) ** 2 / 2
        across, up = (max(pair) for pair in zip(before.doubt, after.doubt, strict=True))
        return float(np.hypot(adrift, across)), up

    def state(self, now: int) -> GpsState:
        """State at a ROS time."""
        last, fix = self._last, self._fixes.last
        fault = ''
        if last is None and not self._fixes.is_awaited(now):
            fault = f'the autopilot does not report GPS_RAW_INT: {_WHERE_NOT}'
        elif fix is not None and fix.fault is not None:
            fault = fix.fault.sentence
        elif self._fixes.is_silent(now):
            fault = f'GPS has given no new fix for {self._fixes.age(now):.1f} s'
        across = up = None
        if self._apart is not None:
            across, up = float(np.hypot(*self._apart[:2])), float(self._apart[2])
        return GpsState(
            fault,
            'none' if last is None else _name(last.fix_type),
            None if last is None else _satellites(last),
            None if last is None else _metres(last.h_acc),
            None if last is None else _metres(last.v_acc),
            self._fixes.age(now),
            across,
            up,
        )

    def _doubt(self, message: Any, now: int) -> tuple[float, float]:
        """What a good fix adds to the estimator's own standard deviations across and up."""
        accuracy = _metres(message.h_acc)
        worse = 0.0
        if accuracy is not None:
            self._best = accuracy if self._best is None else min(self._best, accuracy)
            worse = accuracy - self._best
        across, up = self._disagreement(message, now)
        return max(worse, across), up

    def _disagreement(self, message: Any, now: int) -> tuple[float, float]:
        """How far GPS and the estimator are apart, across and up, where noise is no excuse."""
        place = place_on_earth(message.lat, message.lon, message.alt)
        self._apart = None
        if place is None or self._estimate is None or now - self._estimate[0] > 1e9 * _LONGEST:
            return 0.0, 0.0
        _, estimate, speed = self._estimate
        self._apart = place.offset_of(estimate)
        across, up = float(np.hypot(*self._apart[:2])), abs(float(self._apart[2]))
        noise = max(_LEAST_ACROSS, _metres(message.h_acc) or 0.0)
        noise_up = max(_LEAST_UP, _metres(message.v_acc) or 0.0)
        return (
            across if across > _SIGMAS * noise + _DELAY * speed else 0.0,
            up if up > _SIGMAS * noise_up else 0.0,
        )


def _fault(message: Any) -> Fault | None:
    """What is wrong with a fix."""
    satellites, accuracy = _satellites(message), _metres(message.h_acc)
    counted = '' if satellites is None else f', {satellites} satellites'
    if message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
        return Fault(f'GPS has no fix ({_name(message.fix_type)}{counted})', 'GPS lost')
    if satellites is not None and satellites < _SATELLITES:
        return Fault(
            f'GPS has only {satellites} satellites: {_SATELLITES} are wanted', 'GPS too poor'
        )
    if accuracy is not None and accuracy > _ACCURACY:
        return Fault(
            f'GPS is accurate to {accuracy:.1f} m only: {_ACCURACY:.0f} m are wanted',
            'GPS too poor',
        )
    return None


def _satellites(message: Any) -> int | None:
    count = int(message.satellites_visible)
    return None if count == _UNKNOWN_SATELLITES else count


def _metres(millimetres: int) -> float | None:
    """An accuracy; 0 is that of a MAVLink 1 autopilot, which cannot say it."""
    return 1e-3 * millimetres if millimetres else None


def _name(fix_type: int) -> str:
    entry = mavlink.enums['GPS_FIX_TYPE'].get(fix_type)
    name = f'fix type {fix_type}' if entry is None else entry.name.removeprefix('GPS_FIX_TYPE_')
    return name.replace('_', ' ').lower()
