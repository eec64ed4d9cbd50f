"""The autopilot's poses out of whichever messages it sends: ODOMETRY, or attitude and position."""

from __future__ import annotations

import bisect
import math
from collections import deque
from typing import Any

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.autopilot.vehicle_state import Instant
from ftp_dent_ros.navigation.poses import accuracy, samples
from ftp_dent_ros.navigation.poses.accuracy import Covariance
from ftp_dent_ros.navigation.poses.pose_history import PoseHistory
from ftp_dent_ros.navigation.time_and_place.clock_offset import ClockOffset
from ftp_dent_ros.pose import Pose

# For as long after an ODOMETRY the messages that say less are left alone; seconds.
_PREFERRED = 0.5
_KEPT_COVARIANCES, _KEPT_STEPS = 2048, 8


class PoseSource:
    """Samples of one autopilot, by its time since boot in nanoseconds.

    Parameters
    ----------
    clock : ClockOffset
        Tells what times are possible.
    duration, maximum_gap : float
        As of `PoseHistory`.
    """

    def __init__(self, clock: ClockOffset, duration: float, maximum_gap: float) -> None:
        self._clock = clock
        self._maximum_gap = round(maximum_gap * 1e9)
        self._history = PoseHistory(duration, maximum_gap)
        self._covariances = deque[tuple[int, Covariance | None]](maxlen=_KEPT_COVARIANCES)
        self.malformed = 0
        self.clear()
        self.handlers = {
            'ATTITUDE_QUATERNION': self._on_attitude_quaternion,
            'LOCAL_POSITION_NED': self._on_local_position_ned,
            'ODOMETRY': self._on_odometry,
        }

    def clear(self) -> None:
        """Forget everything: the stamps start anew."""
        self._history.clear()
        self._covariances.clear()
        self._repeated = deque[tuple[int, int]](maxlen=_KEPT_STEPS)
        self._odometry_heard = -math.inf
        self._reset_counter: int | None = None

    @property
    def resets(self) -> int:
        """How often the estimator was reset."""
        return self._history.resets

    def at(self, boot: int) -> Pose:
        """As `PoseHistory.at`; `PoseError` also for a time that has come twice."""
        if any(first <= boot <= last for first, last in self._repeated):
            raise PoseError('a clock stepped back around that time', 'clock stepped')
        return self._history.at(boot)

    def repeat_from(self, boot: int) -> None:
        """The clock has stepped back: times from this one to the newest come twice."""
        self._repeated.append((boot, self._history.newest + self._maximum_gap))

    @property
    def newest(self) -> int:
        """As `PoseHistory.newest`."""
        return self._history.newest

    def stamps_since(self, boot: int) -> list[int]:
        """As `PoseHistory.stamps_since`."""
        return self._history.stamps_since(boot)

    def covariance(self, boot: int, reported: Covariance, clock_uncertainty: float) -> Covariance:
        """Covariance of the pose at a time that `at` has one for.

        `reported` is the estimator's, where ODOMETRY does not bring its own; the clock's
        uncertainty is in seconds.
        """
        after = bisect.bisect_left(self._covariances, boot, key=lambda item: item[0])
        is_odometry, own = False, None
        if after < len(self._covariances):
            stamp, own = self._covariances[after]
            is_odometry = stamp - boot <= self._maximum_gap
        estimate = own if is_odometry and own is not None else reported
        motion = self._history.motion(boot)
        return accuracy.of_tag(estimate, motion, clock_uncertainty, is_odometry)

    def _on_attitude_quaternion(self, message: Any, at: Instant) -> None:
        sample = samples.attitude(message)
        stamp = self._clock.unwrap(message.time_boot_ms, at.ros)
        if sample is None:
            self.malformed += 1
        elif stamp is not None and at.steady - self._odometry_heard > _PREFERRED:
            self._history.add_attitude(stamp, *sample)

    def _on_local_position_ned(self, message: Any, at: Instant) -> None:
        sample = samples.position(message)
        stamp = self._clock.unwrap(message.time_boot_ms, at.ros)
        if sample is None:
            self.malformed += 1
        elif stamp is not None and at.steady - self._odometry_heard > _PREFERRED:
            self._history.add_position(stamp, *sample)

    def _on_odometry(self, message: Any, at: Instant) -> None:
        sample = samples.odometry(message)
        stamp = 1000 * message.time_usec
        if sample is None:
            self.malformed += 1
        elif self._clock.is_plausible(stamp, at.ros):
            if at.steady - self._odometry_heard > _PREFERRED:
                # The others' stamps are those of later moments: the two do not mix.
                self.clear()
            self._odometry_heard = at.steady
            counter, self._reset_counter = self._reset_counter, message.reset_counter
            is_reset = counter is not None and counter != message.reset_counter
            self._history.add_attitude(stamp, *sample.attitude, is_reset)
            if self._history.add_position(stamp, *sample.position, is_reset):
                self._covariances.append((stamp, sample.covariance))
