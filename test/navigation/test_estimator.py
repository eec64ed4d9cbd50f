"""What the estimator's reports vouch for."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.trust import Trust, is_ready

S = 1_000_000_000
ANEW = (1e-6 * number for number in count(1))


@pytest.mark.parametrize(
    ('name', 'flags', 'ready'),
    [
        ('EKF_STATUS_REPORT', 0x33F, True),  # a real ArduCopter with GPS
        ('EKF_STATUS_REPORT', 0x400, False),  # the same while it starts: uninitialised
        ('EKF_STATUS_REPORT', 0x0A7, False),  # aligned, without GPS: constant position mode
        ('EKF_STATUS_REPORT', 0x33F | mavlink.EKF_GPS_GLITCHING, False),
        ('EKF_STATUS_REPORT', 0x33F & ~mavlink.EKF_POS_HORIZ_ABS, True),  # relative position only
        ('EKF_STATUS_REPORT', 0x33F & ~mavlink.EKF_ATTITUDE, False),
        ('ESTIMATOR_STATUS', 0x33F, True),
        ('ESTIMATOR_STATUS', 0x33F | mavlink.ESTIMATOR_GPS_GLITCH, False),
        ('ESTIMATOR_STATUS', 0x33F | mavlink.ESTIMATOR_ACCEL_ERROR, False),
        ('ESTIMATOR_STATUS', 0x33F | mavlink.ESTIMATOR_CONST_POS_MODE, False),
    ],
)
def test_flags_promise_attitude_and_position(name: str, flags: int, ready: bool) -> None:
    assert is_ready(name, flags) is ready


class Reports:
    """Reports of an estimator that navigates without GPS; times in seconds."""

    def __init__(self, *reports: tuple[float, bool]) -> None:
        self.trust = Trust(VehicleSettings(position_source='other'), 0)
        for at, ready in reports:
            self.add(at, flags=0x33F if ready else 0)

    def add(self, at: float, flags: int = 0x33F, **given: float) -> None:
        """Report test ratios that nobody had before, but for those given."""
        new = next(ANEW)
        values = {'velocity_variance': new, 'pos_horiz_variance': 0.01, 'pos_vert_variance': new}
        values |= {'compass_variance': 0.0, 'terrain_alt_variance': 0.0} | given
        message = mavlink.MAVLink_ekf_status_report_message(flags, **values)
        self.trust.handlers['EKF_STATUS_REPORT'](message, Instant(round(at * S), at))

    def state(self, at: float) -> str:
        return self.trust.figures(round(at * S))['estimator']

    def deviation(self, stamp: float, now: float) -> float:
        """Across, metres."""
        covariance, _ = self.trust.check(round(stamp * S), round(now * S))
        return float(np.sqrt(covariance[0, 0]))

    def reason(self, stamp: float, now: float) -> tuple[str, bool]:
        with pytest.raises(PoseError) as refusal:
            self.deviation(stamp, now)
        return refusal.value.reason, isinstance(refusal.value, PoseAwaitedError)


def test_a_stamp_needs_two_good_reports_around_it() -> None:
    reports = Reports((9, False), (10, True), (11, True), (12, False), (13, True), (14, True))
    for stamp in (8.5, 9.5, 11.5, 12.5):
        assert reports.reason(stamp, 15) == ('estimator not ready', False)
    for stamp in (10.5, 13.5):
        reports.deviation(stamp, 15)
    assert Reports((10, True)).reason(10.2, 10.3) == ('estimator report awaited', True)


@pytest.mark.parametrize('rate', [1, 5, 10])
def test_ratios_that_stand_still_are_found_within_a_second_or_two_reports(rate: int) -> None:
    reports = Reports()
    for tick in range(10 * rate):
        at = tick / rate
        frozen = {'velocity_variance': 0.2, 'pos_vert_variance': 0.2} if at >= 5 else {}
        reports.add(at, **frozen)
        if at < 5 + 1 / rate:
            assert reports.state(at) == 'ready'
        elif at >= 6:
            assert reports.state(at) == 'frozen'
            assert reports.reason(at - 0.01, at) == ('estimator frozen', False)
            with pytest.raises(PoseError, match='stood still'):
                reports.deviation(at - 0.01, at)
    reports.add(10)
    assert reports.state(10) == 'ready'


def test_ratios_of_a_position_that_is_only_relative_may_stand_still() -> None:
    reports = Reports()
    flags = 0x33F & ~mavlink.EKF_POS_HORIZ_ABS
    for tick in range(20):
        reports.add(tick / 5, flags, velocity_variance=0.5)
    assert reports.state(4) == 'ready'
    for tick in range(20, 30):
        reports.add(tick / 5, flags, velocity_variance=0.5, pos_vert_variance=0.5)
    assert reports.state(6) == 'frozen'
    with pytest.raises(PoseError, match='no measurement of height'):
        reports.trust.check(6 * S - 1, 6 * S)


def test_the_wider_of_two_reports_counts() -> None:
    reports = Reports()
    for at, ratio in ((1, 0.1), (2, 0.4), (3, 0.2)):
        reports.add(at, pos_horiz_variance=ratio)
    for stamp in (1.5, 2.5):
        assert reports.deviation(stamp, 3) == pytest.approx(1.0, rel=0.01)
