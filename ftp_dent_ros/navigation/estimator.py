"""Whether the autopilot's estimator says that it is ready.

ArduPilot sends EKF_STATUS_REPORT, PX4 and others ESTIMATOR_STATUS. Neither carries a time, so a
stamp is believed only if the reports before and after it both say ready. The worse of the two
also says how good the estimate is.
"""

from __future__ import annotations

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.accuracy import Covariance, unknown

# The low bits mean the same in EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS.
_NEEDED = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_VERT_ABS
)
_ANY_POSITION = mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS
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

_SECOND = 1_000_000_000
# Reports further apart say nothing about the time between them.
_SILENCE = 3 * _SECOND
_KEPT = 128


def is_ready(name: str, flags: int) -> bool:
    """Whether the flags of a report (one of `REPORTS`) promise attitude and local position."""
    return flags & _NEEDED == _NEEDED and bool(flags & _ANY_POSITION) and not flags & _FATAL[name]


class Estimator:
    """Reports of the last seconds; times are ROS times of arrival in nanoseconds."""

    def __init__(self) -> None:
        self._reports: deque[tuple[int, bool, Covariance]] = deque(maxlen=_KEPT)
        self._since: int | None = None

    def restart(self, now: int) -> None:
        """Forget all reports: the autopilot has just been found, or has rebooted."""
        self._reports.clear()
        self._since = now

    def report(self, ready: bool, now: int, covariance: Covariance | None = None) -> None:
        """Take a report that arrived now, and the covariance that it tells."""
        self._reports.append((now, ready, unknown() if covariance is None else covariance))

    def check(self, stamp: int, now: int) -> Covariance:
        """Covariance of shape (6, 6) at a stamp at which the estimator was ready.

        Raises
        ------
        PoseAwaitedError
            The report after the stamp is still to come.
        PoseError
            It was not ready, or fell silent.
        """
        if not self._reports and self._since is not None and now - self._since < _SILENCE:
            raise PoseAwaitedError(
                'the autopilot has not reported the state of its estimator yet',
                'estimator report awaited',
            )
        if not self._reports:
            return unknown()  # This autopilot reports none.
        before = after = None
        for report in reversed(self._reports):
            if report[0] <= stamp:
                before = report
                break
            after = report
        if before is None or not before[1] or (after is not None and not after[1]):
            raise PoseError(
                "the autopilot's estimator was not ready at that time", 'estimator not ready'
            )
        if after is None:
            raise PoseAwaitedError(
                "no report of the estimator's state has come since the stamp",
                'estimator report awaited',
            )
        if after[0] - before[0] > _SILENCE:
            raise PoseError(
                "the autopilot did not report its estimator's state around that time",
                'estimator not reported',
            )
        return max(before[2], after[2], key=lambda covariance: float(covariance.trace()))

    def state(self, now: int) -> str:
        """'ready', 'not ready', 'silent' (reports stopped), 'awaited' or 'not reported'."""
        if not self._reports:
            waits = self._since is None or now - self._since < _SILENCE
            return 'awaited' if waits else 'not reported'
        if now - self._reports[-1][0] > _SILENCE:
            return 'silent'
        return 'ready' if self._reports[-1][1] else 'not ready'
