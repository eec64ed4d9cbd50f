from __future__ import annotations

from itertools import count

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.trust import Estimator, is_ready

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


def report(ready: bool = True, ratios: float | None = None, flags: int = 0x33F):
    """An EKF_STATUS_REPORT, with test ratios that nobody had before or those given."""
    velocity = next(ANEW) if ratios is None else ratios
    return mavlink.MAVLink_ekf_status_report_message(
        flags if ready else 0, velocity, 0.01, velocity, 0, 0
    )


ANEW = (1e-6 * number for number in count(1))


def reporting(*reports: tuple[float, bool]) -> Estimator:
    estimator = Estimator()
    estimator.restart(0)
    for at, ready in reports:
        estimator.report(report(ready), round(at * S))
    return estimator


def reason(estimator: Estimator, stamp: float, now: float) -> tuple[str, bool]:
    with pytest.raises(PoseError) as refusal:
        estimator.check(round(stamp * S), round(now * S))
    return refusal.value.reason, isinstance(refusal.value, PoseAwaitedError)


def test_a_stamp_between_two_good_reports_is_believed() -> None:
    reporting((10, True), (10.5, True)).check(round(10.2 * S), 11 * S)


def test_a_stamp_beside_a_bad_report_is_not() -> None:
    estimator = reporting((9, False), (10, True), (11, True), (12, False), (13, True), (14, True))
    for stamp in (9.5, 11.5, 12.5):
        assert reason(estimator, stamp, 15) == ('estimator not ready', False)
    assert reason(estimator, 8.5, 15) == ('estimator not ready', False)
    for stamp in (10.5, 13.5):
        estimator.check(round(stamp * S), 15 * S)


def test_the_report_after_a_stamp_is_awaited() -> None:
    assert reason(reporting((10, True)), 10.2, 10.3) == ('estimator report awaited', True)
    assert reason(reporting(), 0.2, 0.5) == ('estimator report awaited', True)


def test_one_that_reports_nothing_is_not_believed() -> None:
    estimator = reporting()
    assert estimator.state(1 * S) == 'awaited'
    assert reason(estimator, 1, 4) == ('estimator not reported', False)
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
    estimator.report(report(False), 13 * S)
    assert estimator.state(13 * S) == 'not ready'


@pytest.mark.parametrize('rate', [1, 5, 10])
def test_ratios_that_stand_still_are_told_within_a_second_or_two_reports(rate: int) -> None:
    estimator = reporting()
    for tick in range(10 * rate):
        at = tick / rate
        frozen = 0.2 if at >= 5 else None
        estimator.report(report(ratios=frozen), round(at * S))
        if at < 5 + 1 / rate:
            assert estimator.state(round(at * S)) == 'ready'
        elif at >= 6:
            assert estimator.state(round(at * S)) == 'frozen'
            assert reason(estimator, at - 0.01, at) == ('estimator frozen', False)
            assert 'stood still' in estimator.fault()
    estimator.report(report(), 10 * S)
    assert estimator.state(10 * S) == 'ready'


def test_ratios_of_a_position_that_is_only_relative_may_stand_still() -> None:
    estimator = reporting()
    flags = 0x33F & ~mavlink.EKF_POS_HORIZ_ABS
    for tick in range(20):
        message = report(flags=flags, ratios=0.5)
        message.pos_vert_variance = next(ANEW)
        estimator.report(message, tick * S // 5)
    assert estimator.state(4 * S) == 'ready'
    for tick in range(20, 30):
        estimator.report(report(flags=flags, ratios=0.5), tick * S // 5)
    assert estimator.state(6 * S) == 'frozen'
    assert 'height' in estimator.fault()


def test_the_wider_of_two_reports_counts() -> None:
    estimator = reporting()
    for at, ratio in ((1, 0.1), (2, 0.4), (3, 0.2)):
        message = report()
        message.pos_horiz_variance = ratio
        estimator.report(message, at * S)
    for stamp in (1.5, 2.5):
        deviation = float(np.sqrt(estimator.check(round(stamp * S), 3 * S)[0, 0]))
        assert deviation == pytest.approx(1.0, rel=0.01)
