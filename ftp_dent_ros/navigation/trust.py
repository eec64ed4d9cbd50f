"""Whether a pose can be trusted: what estimator and GPS say before and after it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation import pose_covariance
from ftp_dent_ros.navigation.origin import Origin, place_on_earth
from ftp_dent_ros.navigation.pose_covariance import Covariance
from ftp_dent_ros.navigation.report import enum_name, number
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings

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
# Test ratios of position and of height.
_RATIOS = {
    'EKF_STATUS_REPORT': {
        'position': ('velocity_variance', 'pos_horiz_variance'),
        'height': ('pos_vert_variance',),
    },
    'ESTIMATOR_STATUS': {
        'position': ('vel_ratio', 'pos_horiz_ratio'),
        'height': ('pos_vert_ratio',),
    },
}
# Both autopilots' GPS gives five fixes a second or more, and a link whose rates are not ours to
# set gives one: further apart, seconds, nothing is vouched for.
_LONGEST = 1.5
# What both autopilots ask of GPS before they navigate by it (EK3_GPS_CHECK, EKF2_GPS_CHECK):
# satellites, and metres of horizontal accuracy (ArduPilot; PX4 asks for 3).
_SATELLITES, _ACCURACY = 6, 5.0
# A disagreement is more than so many standard deviations.
_SIGMAS = 3.0
_WITHOUT_GPS = 'set position_source to other if this vehicle navigates without GPS'


class Report(NamedTuple):
    """A report, its ROS time of arrival, and what is wrong with it; without a fault it is good."""

    now: int
    fault: PoseError | None
    value: Any


class ReportHistory:
    """Reports of one kind; times are ROS times of arrival in nanoseconds.

    Parameters
    ----------
    what : str
        What is reported, as the object of 'has not reported'.
    name : str
        The same in a word or two, for the reasons of refusals.
    longest : float
        Reports further apart vouch for nothing between them, seconds.
    since : int
        When the autopilot was found, or rebooted.
    """

    def __init__(self, what: str, name: str, longest: float, since: int) -> None:
        self._what, self._name, self._since = what, name, since
        self._longest = round(longest * 1e9)
        self._reports: deque[Report] = deque(maxlen=256)

    def add(self, fault: PoseError | None, value: Any, now: int) -> None:
        """Take a report that arrived now."""
        self._reports.append(Report(now, fault, value))

    @property
    def last(self) -> Report | None:
        """The latest report."""
        return self._reports[-1] if self._reports else None

    def state(self, now: int) -> str:
        """'ready', or in a word or two why not."""
        if self.last is None or now - self.last.now > self._longest:
            return 'not reported'
        fault = self.last.fault
        return fault.reason.removeprefix(f'{self._name} ') if fault else 'ready'

    def around(self, stamp: int, heard: int) -> tuple[Report, Report]:
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
        # Before the first there is none, nor after the last.
        pairs = pairwise([None, *self._reports, None])
        before, after = [pair for pair in pairs if pair[0] is None or pair[0].now <= stamp][-1]
        for report in (before, after):
            if report is not None and report.fault is not None:
                raise report.fault.with_traceback(None)
        begin = before.now if before else self._since
        end = after.now if after else heard
        if end - begin > self._longest or (after and not before):
            raise PoseError(
                f'the autopilot did not report {self._what} around that time',
                f'{self._name} not reported',
            )
        if not (before and after):
            raise PoseAwaitedError(
                f'the autopilot has not reported {self._what} since the stamp',
                f'{self._name} report awaited',
            )
        return before, after


def is_ready(name: str, flags: int) -> bool:
    """Whether the flags of a report of the estimator promise attitude and local position."""
    return flags & _NEEDED == _NEEDED and bool(flags & _ANY_POSITION) and not flags & _FATAL[name]


class Trust:
    """Follows estimator and GPS of one autopilot; times are ROS times of arrival in ns.

    Parameters
    ----------
    settings : VehicleSettings
    since : int
        When the autopilot was found, or rebooted.
    """

    def __init__(self, settings: VehicleSettings, since: int) -> None:
        estimator = 'the state of its estimator (EKF_STATUS_REPORT or ESTIMATOR_STATUS)'
        fix = f'a new fix of GPS (GPS_RAW_INT; {_WITHOUT_GPS})'
        self._estimator = ReportHistory(estimator, 'estimator', 3.0, since)
        self._gps = ReportHistory(fix, 'GPS', _LONGEST, since)
        self._has_gps = settings.position_source == 'gps'
        self.handlers: dict[str, Callable[[Any, Instant], None]] = {
            **dict.fromkeys(_FATAL, self._on_report),
            'DISTANCE_SENSOR': self._on_distance_sensor,
            'GPS_RAW_INT': self._on_gps_raw_int,
            'GLOBAL_POSITION_INT': self._on_global_position_int,
        }
        # Test ratios of each sensor, and since when they stand still.
        self._ratios: dict[str, tuple[str, int]] = {}
        self._fix: Any = mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0, 255)
        self._best = math.inf
        self._estimate: tuple[int, Origin, float] | None = None
        # How far the estimate is from GPS, across and up, metres.
        self._apart = math.nan, math.nan
        self._ground: float | None = None

    def rates(self, autopilot: int) -> dict[str, float]:
        """Rates, Hz, of the messages wanted of an autopilot (a MAV_AUTOPILOT), by name."""
        is_ardupilot = autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        report = 'EKF_STATUS_REPORT' if is_ardupilot else 'ESTIMATOR_STATUS'
        # As often as GPS gives a fix.
        gps = {'GPS_RAW_INT': 5.0, 'GLOBAL_POSITION_INT': 5.0} if self._has_gps else {}
        return {report: 5.0, 'DISTANCE_SENSOR': 2.0, **gps}

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
            The estimator's own, where ODOMETRY does not bring its own, and what GPS adds to
            either.

        Raises
        ------
        PoseAwaitedError
            A report is needed that is still to come.
        PoseError
            The estimate is not to be believed at that time.
        """
        across = up = 0.0
        # First, for a lost GPS is the cause of what the estimator reports then.
        if self._has_gps:
            before, after = self._gps.around(stamp, heard)
            # An estimator's acceleration is uncertain by 0.1 m/s2: between two fixes it is on its
            # own.
            adrift = 0.1 * (1e-9 * (after.now - before.now)) ** 2 / 2
            across, up = np.maximum(before.value, after.value)
            across = float(np.hypot(adrift, across))
        reports = self._estimator.around(stamp, heard)
        estimate = max((each.value for each in reports), key=lambda each: float(each.trace()))
        return estimate, pose_covariance.diagonal((across, across, up), (0.0, 0.0, 0.0))

    def is_good(self, now: int) -> bool:
        """Whether nothing speaks against the estimate of this moment."""
        is_fixed = not self._has_gps or self._gps.state(now) == 'ready'
        return is_fixed and self._estimator.state(now) == 'ready'

    def figures(self, now: int) -> dict[str, str]:
        """What is known of it, at a ROS time."""
        values = {'estimator': self._estimator.state(now)}
        if self._has_gps:
            fix, last = self._fix, self._gps.last
            values |= {
                'GPS fix': enum_name('GPS_FIX_TYPE', fix.fix_type),
                'GPS satellites': number(_satellites(fix), 0),
                'GPS within, across (m)': number(_metres(fix.h_acc), 2),
                'GPS within, up (m)': number(_metres(fix.v_acc), 2),
                'GPS fix age (s)': number(last and (now - last.now) / 1e9, 2),
                'estimate from GPS, across (m)': number(self._apart[0], 2),
                'estimate from GPS, up (m)': number(self._apart[1], 2),
            }
        if self._ground is not None:
            values['range finder, down (m)'] = number(self._ground, 2)
        return values

    def _on_report(self, message: Any, at: Instant) -> None:
        covariance = pose_covariance.reported(message)
        fault = self._find_frozen(message, at.ros)
        if not is_ready(message.get_type(), message.flags):
            fault = PoseError(
                "the autopilot's estimator was not ready at that time", 'estimator not ready'
            )
        elif covariance is None:
            fault = PoseError(
                "the autopilot's estimator reported an accuracy that cannot be",
                'estimator not ready',
            )
        self._estimator.add(fault, covariance, at.ros)

    def _find_frozen(self, message: Any, now: int) -> PoseError | None:
        """What test ratios say that stand still."""
        for sensor, names in _RATIOS[message.get_type()].items():
            # Compared as text: a NaN differs from itself.
            ratios = repr([getattr(message, name) for name in names])
            if self._ratios.get(sensor, ('', 0))[0] != ratios:
                self._ratios[sensor] = ratios, now
            seconds = (now - self._ratios[sensor][1]) / 1e9
            # Where the position is only relative (optical flow), its ratios are not in use.
            is_used = sensor == 'height' or message.flags & _ABSOLUTE
            # GPS gives a fix five times a second and the report is asked for as often: ratios
            # that stand still for longer have missed three fixes. Barometers are ten times as
            # fast.
            if is_used and seconds >= 0.7:
                return PoseError(
                    "the test ratios of the autopilot's estimator have stood still for "
                    f'{seconds:.1f} s: it uses no measurement of {sensor}',
                    'estimator frozen',
                )
        return None

    def _on_global_position_int(self, message: Any, at: Instant) -> None:
        place = place_on_earth(message.lat, message.lon, message.alt)
        speed = 0.01 * math.hypot(message.vx, message.vy)
        self._estimate = (at.ros, place, speed) if place else None

    def _on_gps_raw_int(self, message: Any, at: Instant) -> None:
        before, self._fix = self._fix, message
        fault = _find_fault(message)
        is_repeated = 0 != message.time_usec == before.time_usec
        if fault or not is_repeated:
            self._gps.add(fault, None if fault else self._doubt(message, at.ros), at.ros)

    def _doubt(self, message: Any, now: int) -> tuple[float, float]:
        """What a good fix adds to the estimator's own standard deviations across and up."""
        accuracy = _metres(message.h_acc)
        self._best = np.fmin(self._best, accuracy)
        worse = np.fmax(0.0, accuracy - self._best)
        place = place_on_earth(message.lat, message.lon, message.alt)
        self._apart = math.nan, math.nan
        if place is None or self._estimate is None or now - self._estimate[0] > 1e9 * _LONGEST:
            return worse, 0.0
        # How far GPS and the estimator are apart, where noise is no excuse.
        _, estimate, speed = self._estimate
        east, north, up = place.offset_of(estimate)
        across = math.hypot(east, north)
        self._apart = across, up
        # Noise of a fix as ArduPilot assumes it where GPS does not say more: EK3_POSNE_M_NSE and
        # EK3_ALT_M_NSE. A fix is some 0.2 s old when it arrives.
        noise, noise_up = np.fmax(0.5, accuracy), np.fmax(2.0, _metres(message.v_acc))
        return (
            max(worse, across if across > _SIGMAS * noise + 0.3 * speed else 0.0),
            abs(up) if abs(up) > _SIGMAS * noise_up else 0.0,
        )

    def _on_distance_sensor(self, message: Any, at: Instant) -> None:
        distance = message.current_distance
        if message.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270:
            is_within = message.min_distance < distance < message.max_distance
            self._ground = 0.01 * distance if is_within else None


def _find_fault(message: Any) -> PoseError | None:
    """What is wrong with a fix."""
    satellites, accuracy = _satellites(message), _metres(message.h_acc)
    if message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
        name = enum_name('GPS_FIX_TYPE', message.fix_type)
        counted = '' if math.isnan(satellites) else f', {satellites:.0f} satellites'
        return PoseError(f'GPS has no fix ({name}{counted})', 'GPS lost')
    if satellites < _SATELLITES:
        wrong = f'GPS has only {satellites:.0f} satellites: {_SATELLITES} are wanted'
    elif accuracy > _ACCURACY:
        wrong = f'GPS is accurate to {accuracy:.1f} m only: {_ACCURACY:.0f} m are wanted'
    else:
        return None
    return PoseError(wrong, 'GPS too poor')


def _satellites(message: Any) -> float:
    """How many are seen; NaN if it does not say."""
    return math.nan if message.satellites_visible == 255 else message.satellites_visible


def _metres(millimetres: int) -> float:
    """An accuracy; 0 is that of a MAVLink 1 autopilot, which cannot say it, and gives NaN."""
    return 1e-3 * millimetres or math.nan
