"""Whether a pose can be trusted: what estimator and GPS say before and after it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import pose_covariance
from ftp_dent_ros.navigation.origin import Origin, place_on_earth
from ftp_dent_ros.navigation.pose_covariance import Covariance, reported
from ftp_dent_ros.navigation.settings import Instant, Settings

_SECOND = 1_000_000_000
# Reports that a time in the past may still be held against.
_KEPT = 256

# The low bits mean the same in EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS.
_NEEDED = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_VERT_ABS
)
_ABSOLUTE = mavlink.EKF_POS_HORIZ_ABS
_ANY_POSITION = mavlink.EKF_POS_HORIZ_REL | _ABSOLUTE
_FATAL = {
    'EKF_STATUS_REPORT': (
        mavlink.EKF_CONST_POS_MODE | mavlink.EKF_UNINITIALIZED | mavlink.EKF_GPS_GLITCHING
    ),
    'ESTIMATOR_STATUS': (
        mavlink.ESTIMATOR_CONST_POS_MODE
        | mavlink.ESTIMATOR_GPS_GLITCH
        | mavlink.ESTIMATOR_ACCEL_ERROR
    ),
}
REPORTS = tuple(_FATAL)
# Reason of a refusal where the test ratios stand still.
FROZEN = 'estimator frozen'

# Reports further apart say nothing about the time between them; seconds.
_SILENCE = 3.0
# GPS gives a fix five times a second and the report is asked for as often: ratios that stand
# still for longer have missed three fixes. Barometers are ten times as fast.
_STILL = 0.7
_NANOSECONDS = 1e9

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

# As often as GPS gives a fix.
_RATE, _RANGE_RATE = 5.0, 2.0
_DOWN = mavlink.MAV_SENSOR_ROTATION_PITCH_270


@dataclass(frozen=True)
class Fault:
    """Why a report vouches for nothing: a sentence, and the few fixed words it is counted by."""

    sentence: str
    reason: str


class Report(Protocol):
    """A report; without a fault it is good."""

    @property
    def fault(self) -> Fault | None:
        """What is wrong with it."""


R = TypeVar('R', bound=Report)


class Witness(Generic[R]):
    """Reports of one kind; times are ROS times of arrival in nanoseconds.

    Parameters
    ----------
    what : str
        What is reported, as the object of 'has not reported'.
    name : str
        The same in a word or two, for the reasons of refusals.
    longest : float
        Reports further apart vouch for nothing between them, seconds.
    """

    def __init__(self, what: str, name: str, longest: float) -> None:
        self._what, self._name = what, name
        self._longest = round(longest * _SECOND)
        self._reports: deque[tuple[int, R]] = deque(maxlen=_KEPT)
        self._since: int | None = None

    def restart(self, now: int) -> None:
        """Forget all reports: the autopilot has just been found, or has rebooted."""
        self._reports.clear()
        self._since = now

    def add(self, report: R, now: int) -> None:
        """Take a report that arrived now."""
        self._reports.append((now, report))

    @property
    def last(self) -> R | None:
        """The latest report."""
        return self._reports[-1][1] if self._reports else None

    def age(self, now: int) -> float | None:
        """Seconds since the latest report."""
        return (now - self._reports[-1][0]) / _SECOND if self._reports else None

    def is_awaited(self, now: int) -> bool:
        """Whether none has come, but it is too early to say that none will."""
        return not self._reports and (self._since is None or now - self._since < self._longest)

    def is_silent(self, now: int) -> bool:
        """Whether too much time has passed since the latest report."""
        return bool(self._reports) and now - self._reports[-1][0] > self._longest

    def around(self, stamp: int, heard: int) -> tuple[R, R]:
        """The good reports before and after a stamp.

        `heard` is when the autopilot was last heard at all: silence of the whole link is not
        silence about this.

        Raises
        ------
        PoseAwaitedError
            The report after the stamp is still to come.
        PoseError
            One of them is bad, or too long did not come.
        """
        if self.is_awaited(heard):
            raise PoseAwaitedError(
                f'the autopilot has not reported {self._what} yet', f'{self._name} report awaited'
            )
        if not self._reports:
            raise PoseError(
                f'the autopilot does not report {self._what}', f'{self._name} not reported'
            )
        before: tuple[int, R] | None = None
        after: tuple[int, R] | None = None
        for entry in reversed(self._reports):
            if entry[0] <= stamp:
                before = entry
                break
            after = entry
        for entry in filter(None, (before, after)):
            fault = entry[1].fault
            if fault is not None:
                raise PoseError(fault.sentence, fault.reason)
        if before is None:
            raise PoseError(
                f'the autopilot had not reported {self._what} by that time',
                f'{self._name} not reported',
            )
        if (after[0] if after else heard) - before[0] > self._longest:
            raise PoseError(
                f'the autopilot did not report {self._what} around that time',
                f'{self._name} not reported',
            )
        if after is None:
            raise PoseAwaitedError(
                f'the autopilot has not reported {self._what} since the stamp',
                f'{self._name} report awaited',
            )
        return before[1], after[1]


_NOT_READY = Fault("the autopilot's estimator was not ready at that time", 'estimator not ready')
_IMPOSSIBLE = Fault(
    "the autopilot's estimator reported an accuracy that cannot be", 'estimator not ready'
)


def is_ready(name: str, flags: int) -> bool:
    """Whether the flags of a report (one of `REPORTS`) promise attitude and local position."""
    return flags & _NEEDED == _NEEDED and bool(flags & _ANY_POSITION) and not flags & _FATAL[name]


@dataclass(frozen=True)
class _Report:
    fault: Fault | None
    covariance: Covariance | None


class _Ratios:
    """Since when the test ratios of one sensor stand still."""

    def __init__(self, sensor: str) -> None:
        self._sensor = sensor
        self._values = ''
        self._since = 0

    def fault(self, values: tuple[float, ...], now: int) -> Fault | None:
        """What standing still tells by now. Compared as text: a NaN differs from itself."""
        if repr(values) != self._values:
            self._values, self._since = repr(values), now
        seconds = (now - self._since) / _NANOSECONDS
        if seconds < _STILL:
            return None
        return Fault(
            f"the test ratios of the autopilot's estimator have stood still for {seconds:.1f} s: "
            f'it uses no measurement of {self._sensor}',
            FROZEN,
        )


class Estimator:
    """Reports of the last seconds; times are ROS times of arrival in nanoseconds."""

    def __init__(self) -> None:
        self._reports: Witness[_Report] = Witness(
            'the state of its estimator (EKF_STATUS_REPORT or ESTIMATOR_STATUS)',
            'estimator',
            _SILENCE,
        )
        self.restart(None)

    def restart(self, now: int | None) -> None:
        """Forget all reports: the autopilot has just been found, or has rebooted."""
        if now is not None:
            self._reports.restart(now)
        self._position, self._height = _Ratios('position'), _Ratios('height')

    def report(self, message: Any, now: int) -> None:
        """Take an EKF_STATUS_REPORT or ESTIMATOR_STATUS that arrived now."""
        name = message.get_type()
        covariance = reported(message)
        if name == 'EKF_STATUS_REPORT':
            position = (message.velocity_variance, message.pos_horiz_variance)
            height = (message.pos_vert_variance,)
        else:
            position = (message.vel_ratio, message.pos_horiz_ratio)
            height = (message.pos_vert_ratio,)
        # Where the position is only relative (optical flow), these ratios are not in use.
        faults = [
            self._position.fault(position, now) if message.flags & _ABSOLUTE else None,
            self._height.fault(height, now),
        ]
        if not is_ready(name, message.flags):
            faults.insert(0, _NOT_READY)
        elif covariance is None:
            faults.insert(0, _IMPOSSIBLE)
        fault = next(filter(None, faults), None)
        self._reports.add(_Report(fault, covariance), now)

    def check(self, stamp: int, heard: int) -> Covariance:
        """Covariance of shape (6, 6) at a stamp at which the estimator was ready.

        Raises
        ------
        PoseAwaitedError, PoseError
            As of `Witness.around`.
        """
        around = self._reports.around(stamp, heard)
        # Good ones have a covariance.
        told = [report.covariance for report in around if report.covariance is not None]
        return max(told, key=lambda covariance: float(covariance.trace()))

    def fault(self) -> str:
        """What the latest report tells that is wrong, '' if nothing is."""
        last = self._reports.last
        return last.fault.sentence if last is not None and last.fault is not None else ''

    def state(self, now: int) -> str:
        """'ready', 'not ready', 'frozen', 'silent', 'awaited' or 'not reported'."""
        if self._reports.is_awaited(now):
            return 'awaited'
        last = self._reports.last
        if last is None:
            return 'not reported'
        if self._reports.is_silent(now):
            return 'silent'
        return last.fault.reason.removeprefix('estimator ') if last.fault else 'ready'


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


class Trust:
    """Follows one autopilot; times are ROS times of arrival in nanoseconds."""

    def __init__(self, settings: Settings) -> None:
        self._estimator = Estimator()
        self._gps = Gps() if settings.position_source == 'gps' else None
        self._ground: float | None = None
        self.handlers = {
            **dict.fromkeys(REPORTS, self._on_report),
            'GPS_RAW_INT': self._on_gps_raw_int,
            'GLOBAL_POSITION_INT': self._on_global_position_int,
            'DISTANCE_SENSOR': self._on_distance_sensor,
        }

    def rates(self, autopilot: int) -> dict[str, float]:
        """Rates, Hz, of the messages wanted of an autopilot (a MAV_AUTOPILOT), by name."""
        is_ardupilot = autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        report = 'EKF_STATUS_REPORT' if is_ardupilot else 'ESTIMATOR_STATUS'
        wanted = {report: _RATE, 'DISTANCE_SENSOR': _RANGE_RATE}
        if self._gps is not None:
            wanted |= {'GPS_RAW_INT': _RATE, 'GLOBAL_POSITION_INT': _RATE}
        return wanted

    def restart(self, now: int) -> None:
        """Forget all: the autopilot has just been found, or has rebooted."""
        self._estimator.restart(now)
        self._ground = None
        if self._gps is not None:
            self._gps.restart(now)

    def check(self, stamp: int, heard: int) -> tuple[Covariance, Covariance]:
        """Covariances of shape (6, 6) of the estimate at a stamp.

        Parameters
        ----------
        stamp : int
        heard : int
            When the autopilot was last heard at all.

        Returns
        -------
        tuple of ndarray
            What the estimator tells, where ODOMETRY does not bring its own, and what GPS adds to
            either.

        Raises
        ------
        PoseAwaitedError
            A report is needed that is still to come.
        PoseError
            The estimate is not to be believed at that time.
        """
        try:
            estimate = self._estimator.check(stamp, heard)
        except PoseError as error:
            if error.reason == FROZEN and self._gps is not None:
                self._gps.check(stamp, heard)  # Rather the cause than what comes of it.
            raise
        across, up = (0.0, 0.0) if self._gps is None else self._gps.check(stamp, heard)
        return estimate, pose_covariance.diagonal((across, across, up), (0.0, 0.0, 0.0))

    def is_good(self, now: int) -> bool:
        """Whether nothing speaks against the estimate of this moment."""
        gps = None if self._gps is None else self._gps.state(now)
        is_fixed = gps is None or (not gps.fault and gps.age is not None)
        return is_fixed and self._estimator.state(now) == 'ready'

    def state(self, now: int) -> dict[str, Any]:
        """What `VehicleState` holds of it, at a ROS time."""
        return {
            'estimator': self._estimator.state(now),
            'estimator_fault': self._estimator.fault(),
            'gps': None if self._gps is None else self._gps.state(now),
            'above_ground': self._ground,
        }

    def _on_report(self, message: Any, at: Instant) -> None:
        self._estimator.report(message, at.ros)

    def _on_gps_raw_int(self, message: Any, at: Instant) -> None:
        if self._gps is not None:
            self._gps.on_gps_raw_int(message, at.ros)

    def _on_global_position_int(self, message: Any, at: Instant) -> None:
        if self._gps is not None:
            self._gps.on_global_position_int(message, at.ros)

    def _on_distance_sensor(self, message: Any, at: Instant) -> None:
        distance = message.current_distance
        if message.orientation == _DOWN:
            is_within = message.min_distance < distance < message.max_distance
            self._ground = 0.01 * distance if is_within and math.isfinite(distance) else None
