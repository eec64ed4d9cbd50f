"""What speaks against the autopilot's estimate, and how soon that counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle import GRANTED, MS, S, World

from ftp_dent_ros.errors import PoseError
from ftp_dent_ros.navigation.settings import VehicleSettings


def test_without_a_report_of_the_estimator_there_is_no_pose_and_no_go() -> None:
    world = World()
    world.reports = False
    world.run(5)
    assert world.reason(1.0) == ('estimator not reported', False)
    assert world.poses == []
    assert 'did not report the state of its estimator' in world.verdict()
    assert world.severity() == 'error'


def first_refused(world: World, seconds: float = 7.0) -> tuple[float, set[str]]:
    """How long poses are still given from now on, seconds, and why they are refused then."""
    begin, given, reasons = world.now, 0.0, set()
    world.run(seconds)
    for stamp in range(begin, world.now - 400 * MS, 20 * MS):
        reason = refusal(world, stamp)
        reasons.add(reason)
        given = given if reason else (stamp - begin) / S
    return given, reasons - {''}


def refusal(world: World, stamp: int) -> str:
    try:
        world.vehicle.tag_at(stamp, world.at)
    except PoseError as error:
        return error.reason
    return ''


@pytest.mark.parametrize(
    ('gps', 'reason'),
    [
        ({'fix_type': 1, 'satellites_visible': 3}, 'GPS lost'),
        ({'fix_type': 2}, 'GPS lost'),
        ({'satellites_visible': 5}, 'GPS too poor'),
        ({'h_acc': 7000}, 'GPS too poor'),
        (None, 'GPS not reported'),  # the last fix once more
    ],
)
def test_a_lost_gps_is_refused_at_once_though_the_estimator_says_ready(gps, reason) -> None:
    world = World().run(5)
    world.gps, world.fixes = gps or {}, gps is not None
    given, reasons = first_refused(world)
    assert given < 0.25
    assert reasons == {reason}
    assert world.severity() == 'error' and 'GPS' in world.verdict()
    count = len(world.poses)
    world.run(1)
    assert len(world.poses) == count  # nor are they streamed
    world.gps, world.fixes = {}, True
    world.run(1)
    assert world.pose_at(0.4)
    assert world.verdict() == 'believing the autopilot 1/1'


def test_without_gps_a_vehicle_has_to_say_so() -> None:
    for source, expected in (('gps', False), ('other', True)):
        world = World(VehicleSettings(position_source=source))  # type: ignore[arg-type]
        world.grants = GRANTED - {mavlink.MAVLINK_MSG_ID_GPS_RAW_INT}
        world.run(5)
        assert bool(world.poses) is expected
        assert ('set position_source to other' in world.verdict()) is not expected
    assert mavlink.MAVLINK_MSG_ID_GPS_RAW_INT not in world.asked


def deviations(world: World) -> Any:
    covariance = world.vehicle.tag_at(world.now - 500 * MS, world.at).covariance
    return np.sqrt(np.diag(covariance))


def test_height_is_stated_with_the_barometers_scale() -> None:
    assert_allclose(deviations(World().run(5))[2], np.hypot(0.05, 0.04 * 5), rtol=0.01)
    flat = World(VehicleSettings(height_scale_uncertainty=0.0)).run(5)
    assert_allclose(deviations(flat)[2], 0.05, rtol=0.01)


@pytest.mark.parametrize(('gap', 'is_given'), [(1.0, True), (1.4, True), (2.0, False)])
def test_between_fixes_far_apart_the_tag_is_wider_or_there_is_none(gap, is_given) -> None:
    world = World().run(5)
    world.fixes = False
    world.run(gap - 0.2)
    stamp = world.now - 300 * MS
    world.fixes = True
    world.run(1)
    if is_given:
        across = np.sqrt(world.vehicle.tag_at(stamp, world.at).covariance[0, 0])
        assert across == pytest.approx(np.hypot(0.036, 0.1 * gap**2 / 2), rel=0.2)
    else:
        assert refusal(world, stamp) == 'GPS not reported'


def test_a_gps_that_grows_worse_widens_the_tag_at_once() -> None:
    world = World().run(5)
    before = deviations(world)[0]
    world.gps = {'h_acc': 2800}
    world.run(1)
    assert before < 0.06 and deviations(world)[0] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    ('gps', 'axis', 'apart'),
    [
        ({'lat': 474_500_000 + 450}, 1, 5.0),
        ({'lon': 85_600_000 + 700}, 0, 5.3),
        ({'alt': 443_000}, 2, 8.0),
        ({'lat': 474_500_000 + 90}, 1, 0.036),
        ({'alt': 437_000}, 2, 0.2),
    ],
)
def test_an_estimate_that_is_not_where_gps_is_is_stated_as_far_off(gps, axis, apart) -> None:
    world = World()
    world.run(3)
    world.grants = GRANTED
    for _ in range(10):
        world.gps = gps
        place = (474_500_000, 85_600_000, 435_000, 5000, 100, 0, 0, 0)
        world.say(mavlink.MAVLink_global_position_int_message(world.boot_ms(), *place))
        world.run(0.1)
    assert deviations(world)[axis] == pytest.approx(apart, rel=0.2)
