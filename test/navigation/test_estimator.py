from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.estimator import Estimator, is_ready

S = 1_000_000_000


@pytest.mark.parametrize(
    ('flags', 'ready'),
    [
        (0x33F, True),  # a real ArduCopter with GPS
        (0x400, False),  # the same while it starts: uninitialised
        (0x0A7, False),  # aligned, without GPS: constant position mode
        (0x000, False),
        (0x33F | mavlink.EKF_GPS_GLITCHING, False),
        (0x33F & ~mavlink.EKF_POS_HORIZ_ABS, True),  # indoors: relative position only
        (0x33F & ~(mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_POS_HORIZ_REL), False),
        (0x33F & ~mavlink.EKF_POS_VERT_ABS, False),
        (0x33F & ~mavlink.EKF_ATTITUDE, False),
    ],
)
def test_flags_of_ardupilot(flags: int, ready: bool) -> None:
    assert is_ready('EKF_STATUS_REPORT', flags) is ready


@pytest.mark.parametrize(
    ('flags', 'ready'),
    [
        (0x33F, True),
        (0x33F | mavlink.ESTIMATOR_GPS_GLITCH, False),
        (0x33F | mavlink.ESTIMATOR_ACCEL_ERROR, False),
        (0x33F | mavlink.ESTIMATOR_CONST_POS_MODE, False),
        (0x007, False),
    ],
)
def test_flags_of_px4(flags: int, ready: bool) -> None:
    assert is_ready('ESTIMATOR_STATUS', flags) is ready


def reporting(*reports: tuple[float, bool]) -> Estimator:
    estimator = Estimator()
    estimator.restart(0)
    for at, ready in reports:
        estimator.report(ready, round(at * S))
    return estimator


def reason(estimator: Estimator, stamp: float, now: float) -> tuple[str, bool]:
    with pytest.raises(PoseError) as refusal:
        estimator.check(round(stamp * S), round(now * S))
    return refusal.value.reason, isinstance(refusal.value, PoseAwaitedError)


def test_a_stamp_between_two_good_reports_is_believed() -> None:
    reporting((10, True), (10.5, True)).check(round(10.2 * S), 11 * S)


def test_a_stamp_beside_a_bad_report_is_not() -> None:
    estimator = reporting((9, False), (10, True), (11, True), (12, False), (13, True), (14, True))
    for stamp in (8.5, 9.5, 11.5, 12.5):
        assert reason(estimator, stamp, 15) == ('estimator not ready', False)
    for stamp in (10.5, 13.5):
        estimator.check(round(stamp * S), 15 * S)


def test_the_report_after_a_stamp_is_awaited() -> None:
    assert reason(reporting((10, True)), 10.2, 10.3) == ('estimator report awaited', True)
    assert reason(reporting(), 0.2, 0.5) == ('estimator report awaited', True)


def test_an_autopilot_that_reports_nothing_is_believed_after_a_while() -> None:
    estimator = reporting()
    assert estimator.state(1 * S) == 'awaited'
    estimator.check(1 * S, 4 * S)
    assert estimator.state(4 * S) == 'not reported'


def test_one_that_stopped_reporting_is_not() -> None:
    estimator = reporting((10, True), (20, True))
    assert reason(estimator, 15, 20) == ('estimator not reported', False)
    assert estimator.state(21 * S) == 'ready'
    assert estimator.state(24 * S) == 'silent'


def test_after_a_restart_it_is_as_new() -> None:
    estimator = reporting((10, True), (11, True))
    estimator.restart(12 * S)
    assert reason(estimator, 10.5, 12) == ('estimator report awaited', True)
    assert estimator.state(12 * S) == 'awaited'
    estimator.report(False, 13 * S)
    assert estimator.state(13 * S) == 'not ready'
