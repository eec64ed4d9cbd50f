"""ODOMETRY as PX4 sends it, beside the messages that say less."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_vehicle import MS, NOSE_EAST, START, S, World, attitude, gps_raw_int, heartbeat, position

from ftp_dent_ros.errors import PoseError

LOCAL = mavlink.MAV_FRAME_LOCAL_NED
VARIANCES = [0.01, 0.02, 0.04, 1e-4, 2e-4, 4e-4]


def odometry(time_us: int, north: float, **given: Any) -> Any:
    covariance = np.full(21, np.nan)
    covariance[[0, 6, 11, 15, 18, 20]] = VARIANCES
    values = {'frame_id': LOCAL, 'child_frame_id': LOCAL, 'q': NOSE_EAST}
    values |= {'x': north, 'y': 0, 'z': -5, 'vx': 1, 'vy': 0, 'vz': 0}
    values |= dict.fromkeys(('rollspeed', 'pitchspeed', 'yawspeed'), 0)
    values |= {'pose_covariance': covariance, 'velocity_covariance': np.full(21, np.nan)}
    return mavlink.MAVLink_odometry_message(time_us, **(values | given))


class Px4(World):
    """Grants ODOMETRY; its others are 9 m off, so that they show where they should not."""

    def __init__(self) -> None:
        super().__init__()
        self.grants = self.grants | {mavlink.MAVLINK_MSG_ID_ODOMETRY}
        self.given: dict[str, Any] = {}
        self.jump = 0.0
        self.others = 9.0
        self.accuracies = 0.5, 0.8
        self.says_odometry = True
        self.time_us: int | None = None
        self.say(heartbeat(mavlink.MAV_AUTOPILOT_PX4))

    def _send(self, message_id: int) -> None:
        north = (self.now - START) / S + self.jump
        if message_id == mavlink.MAVLINK_MSG_ID_ODOMETRY:
            if self.says_odometry:
                boot_us = (self.now - self.boot) // 1000 - 4321
                time_us = boot_us if self.time_us is None else self.time_us
                self.say(odometry(time_us, north - 4321e-6, **self.given))
        elif message_id == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            self.say(position(self.boot_ms(), north + self.others))
        elif message_id == mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            self.say(attitude(self.boot_ms(), (1, 0, 0, 0)))
        elif message_id == mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
            boot_us = (self.now - self.boot) // 1000
            ratio = 0.1 + 1e-13 * (self.now % S)
            self.say(
                mavlink.MAVLink_estimator_status_message(
                    boot_us, self.flags, ratio, 0.1, ratio, 0.1, 0, 0, *self.accuracies
                )
            )
        else:
            super()._send(message_id)


def test_its_poses_are_those_of_its_samples_with_its_own_covariance() -> None:
    world = Px4().run(10)
    for ago in np.linspace(0.3, 3, 40):
        tag = world.vehicle.tag_at(world.now - round(ago * S), world.at)
        assert_allclose(tag.pose.translation, [0, 10 - ago, 5], atol=1e-6)
        assert_allclose(tag.pose.rotation.apply([1, 0, 0]), [1, 0, 0], atol=1e-6)
        # Its own, and the barometer's scale at 5 m.
        told = [0.02, 0.01, 0.04 + 0.2**2, 2e-4, 1e-4, 4e-4]
        assert_allclose(np.diag(tag.covariance), told, rtol=0.02)
    assert world.figure('ODOMETRY (Hz)') == pytest.approx(50, abs=2)
    assert world.vehicle.figures(world.at)['estimator'] == 'ready'
    assert world.figure('estimator resets') == 0


def test_without_its_own_covariance_the_estimators_status_counts() -> None:
    world = Px4()
    world.given = {'pose_covariance': np.full(21, np.nan)}
    tag = world.run(10).vehicle.tag_at(world.now - S, world.at)
    told = [0.5, 0.5, np.hypot(0.8, 0.2)]
    assert_allclose(np.sqrt(np.diag(tag.covariance))[:3], told, rtol=0.01)


def test_px4_without_gps_is_refused_from_its_last_fix_on() -> None:
    world = Px4().run(5)
    lost = world.now
    world.intervals.pop(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT)  # It sends none without new data.
    world.grants = world.grants - {mavlink.MAVLINK_MSG_ID_GPS_RAW_INT}
    world.run(1.7)
    assert world.reason((world.now - lost) / S - 0.01) == ('GPS not reported', False)
    assert 'the autopilot did not report a new fix of GPS' in world.verdict()
    none = gps_raw_int(0, fix_type=0, satellites_visible=255)  # as it says a second later
    assert world.say(none)
    assert world.reason(0.3)[0] == 'GPS lost'
    assert 'GPS has no fix (no gps)' in world.verdict()


@pytest.mark.parametrize('counted', [True, False])
def test_a_reset_is_not_interpolated_across_whether_it_is_counted_or_seen(counted: bool) -> None:
    world = Px4().run(5)
    reset = world.now
    # Too small a jump to be seen is counted; one that is not counted is seen.
    world.jump = 0.04 if counted else 1.0
    world.given = {'reset_counter': 1} if counted else {}
    world.run(2)
    assert world.figure('estimator resets') == (2 if counted else 1)
    refused = 0
    for stamp in range(reset - 100 * MS, reset + 100 * MS, MS):
        try:
            north = world.vehicle.tag_at(stamp, world.at).pose.translation[1]
        except PoseError as error:
            assert error.reason == 'estimator reset'
            refused += 1
            continue
        jump = world.jump if stamp > reset - 5 * MS else 0
        assert north == pytest.approx((stamp - START) / S + jump, abs=1e-5)
    assert 0 < refused <= 20


def test_when_it_ends_the_other_messages_take_over() -> None:
    world = Px4()
    world.others = 0.0
    world.run(5)
    world.says_odometry = False
    world.run(5)
    assert_allclose(world.pose_at(1.0).translation, [0, 9, 5], atol=2e-3)
    # The attitude's other source is turned, which is as good as a reset.
    assert world.reason(4.9)[0] in ('gap in the samples', 'estimator reset')


@pytest.mark.parametrize('time_us', [0, 2**63, 1_800_000_000_000_000])
def test_a_time_that_is_not_of_this_boot_is_not_taken(time_us: int) -> None:
    world = Px4()
    world.others = 0.0
    world.time_us = time_us
    world.run(5)
    assert_allclose(world.pose_at(1.0).translation, [0, 4, 5], atol=2e-3)
