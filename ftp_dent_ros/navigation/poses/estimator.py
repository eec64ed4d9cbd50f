"""Whether the autopilot's estimator says that it is ready, and how good it says its estimate is.

ArduPilot sends EKF_STATUS_REPORT, PX4 and others ESTIMATOR_STATUS. Without either there is no
pose. Both carry the test ratios of the measurements: each is computed anew whenever a measurement
is used, so ratios that stand still tell that none is, for seconds before the flags do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.navigation.poses.accuracy import Covariance, reported
from ftp_dent_ros.navigation.poses.witness import Fault, Witness

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
