"""Whom the vehicle believes and when, message by message in virtual time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import PoseAwaitedError, PoseError
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.vehicle import Vehicle

START = 1_800_000_000_000_000_000
S, MS = 1_000_000_000, 1_000_000
READY = 0x33F
# ArduPilot denies ODOMETRY.
GRANTED = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
}
NOSE_EAST = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))


def heartbeat(autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA) -> Any:
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, autopilot, 0, 0, 4, 3)


class World:
    """An autopilot at 1/1 that does as it is asked, and a vehicle that listens to it.

    It hovers 5 m above a point that moves north at 1 m/s, nose east.
    """

    def __init__(
        self, settings: VehicleSettings | None = None, boot: int = START - 100 * S
    ) -> None:
        self.vehicle = Vehicle(settings or VehicleSettings())
        self.now = START
        self.ahead = 0  # of the computer's clock
        self.boot = boot
        self.flags = READY
        self.reports = True
        self.gps: dict[str, Any] = {}  # what GPS_RAW_INT says that is not usual
        self.fixes = True
        self.answers = True
        self.round_trip = 0
        self._answers: list[tuple[int, Any]] = []
        self.silent = False
        self.intervals: dict[int, int] = {}
        self.asked: list[int] = []
        self.grants = GRANTED
        self.poses: list[tuple[int, Any]] = []
        self._senders: dict[tuple[int, int], mavlink.MAVLink] = {}

    @property
    def at(self) -> Instant:
        return Instant(self.now + self.ahead, self.now / S)

    def boot_ms(self) -> int:
        return (self.now - self.boot) // MS

    def say(self, message: Any, system: int = 1, component: int = 1) -> bool:
        """Bring a message over the wire, as bytes."""
        sender = self._senders.setdefault(
            (system, component), mavlink.MAVLink(None, system, component)
        )
        data = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        (heard,) = mavlink.MAVLink(None).parse_buffer(data)
        return self.vehicle.receive(heard, self.at)

    def run(self, seconds: float) -> World:
        end = self.now + round(seconds * S)
        while self.now < end:
            self._tick()
            self.now += 10 * MS
        return self

    def _tick(self) -> None:
        tick = self.now // (10 * MS)
        if not self.silent:
            if tick % 100 == 0:
                self.say(heartbeat())
            for message_id, interval in self.intervals.items():
                if tick % max(1, interval // 10_000) == 0:
                    self._send(message_id)
        for request in self.vehicle.requests(self.at):
            if not self.silent:
                self._obey(request)
        while self._answers and self._answers[0][0] <= self.now:
            self.say(self._answers.pop(0)[1])
        self.poses += self.vehicle.new_poses(self.at)

    def _send(self, message_id: int) -> None:
        north = (self.now - START) / S
        if message_id == mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            self.say(attitude(self.boot_ms()))
        elif message_id == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            self.say(position(self.boot_ms(), north))
        elif message_id == mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT and self.reports:
            ratio = 1e-13 * (self.now % S)
            self.say(mavlink.MAVLink_ekf_status_report_message(self.flags, ratio, 0, ratio, 0, 0))
        elif message_id == mavlink.MAVLINK_MSG_ID_GPS_RAW_INT:
            if self.fixes:
                self._fixed_us = (self.now - self.boot) // 1000 - 100_000
            self.say(gps_raw_int(self._fixed_us, **self.gps))

    def _obey(self, request: Any) -> None:
        name = request.get_type()
        if name == 'TIMESYNC' and self.answers:
            there = self.now + self.round_trip // 2 - self.boot
            answer = mavlink.MAVLink_timesync_message(there, request.ts1)
            self._answers.append((self.now + self.round_trip, answer))
        elif name == 'COMMAND_LONG':
            self.asked.append(int(request.param1))
            if request.command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                return
            if int(request.param1) not in self.grants:
                self.say(mavlink.MAVLink_command_ack_message(request.command, 2, 0, 0, 1, 191))
                return
            self.intervals[int(request.param1)] = int(request.param2)
            self.say(mavlink.MAVLink_command_ack_message(request.command, 0, 0, 0, 1, 191))

    def pose_at(self, seconds_ago: float) -> Any:
        return self.vehicle.tag_at(self.now - round(seconds_ago * S), self.at).pose

    def reason(self, seconds_ago: float) -> tuple[str, bool]:
        with pytest.raises(PoseError) as refusal:
            self.pose_at(seconds_ago)
        return refusal.value.reason, isinstance(refusal.value, PoseAwaitedError)

    def figure(self, name: str) -> float:
        return float(self.vehicle.figures(self.at)[name])

    def verdict(self) -> str:
        return self.vehicle.verdict(self.at).text

    def severity(self) -> str:
        return self.vehicle.verdict(self.at).severity


def gps_raw_int(time_usec: int, **given: Any) -> Any:
    usual = {'fix_type': 3, 'lat': 474_500_000, 'lon': 85_600_000, 'alt': 435_000}
    usual |= {'eph': 100, 'epv': 100, 'vel': 100, 'cog': 0, 'satellites_visible': 12}
    usual |= {'h_acc': 800, 'v_acc': 1200}
    return mavlink.MAVLink_gps_raw_int_message(time_usec, **(usual | given))


def attitude(boot_ms: int, quaternion: Any = NOSE_EAST) -> Any:
    return mavlink.MAVLink_attitude_quaternion_message(boot_ms, *quaternion, 0, 0, 0)


def position(boot_ms: int, north: float, down: float = -5.0) -> Any:
    return mavlink.MAVLink_local_position_ned_message(boot_ms, north, 0, down, 1, 0, 0)


def test_a_cloud_gets_the_pose_at_its_stamp() -> None:
    world = World().run(10)
    stamp = world.now - 755 * MS
    pose = world.vehicle.tag_at(stamp, world.at).pose
    # Stamps are whole milliseconds.
    assert_allclose(pose.translation, [0, (stamp - START) / S, 5], atol=2e-3)
    assert_allclose(pose.rotation.apply([1, 0, 0]), [1, 0, 0], atol=1e-6)
    assert world.verdict() == 'believing the autopilot 1/1'
    # The stream gives each pose once.
    stamps = [stamp for stamp, _ in world.poses]
    assert np.all(np.diff(stamps) > 0) and np.median(np.diff(stamps)) == 20 * MS
    stamp, pose = world.poses[-1]
    assert_allclose(pose.translation[1], (stamp - START) / S, atol=2e-3)


def test_a_message_that_is_denied_is_named_and_asked_for_ever_more_slowly() -> None:
    world = World()
    world.grants = GRANTED - {mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED}
    world.run(5)
    assert 'no position has come from the autopilot' in world.verdict()
    world.run(50)
    assert 8 < world.asked.count(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED) < 14
    world.grants = GRANTED
    world.run(10)
    assert world.verdict() == 'believing the autopilot 1/1'


def test_it_asks_for_what_it_needs_and_no_more() -> None:
    world = World().run(20)
    granted = GRANTED - {mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS}
    assert {number: world.asked.count(number) for number in granted} == dict.fromkeys(granted, 1)
    denied = {
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
        mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR,
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
    }
    assert set(world.asked) == granted | denied
    assert max(world.asked.count(number) for number in denied) < 10
    assert world.intervals[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] == 20_000
    assert world.intervals[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == 20_000


def test_it_believes_the_first_autopilot_and_from_then_on_no_other() -> None:
    world = World()
    invalid = mavlink.MAV_AUTOPILOT_INVALID
    assert not world.say(heartbeat(invalid), 255, 190)  # a ground station
    assert not world.say(heartbeat(invalid), 1, 191)  # a companion
    assert not world.say(heartbeat(mavlink.MAV_AUTOPILOT_PX4), 1, 154)  # a gimbal
    assert world.vehicle.identity is None
    assert world.say(heartbeat(), 7, 1)
    assert not world.say(heartbeat(), 1, 1)
    assert world.vehicle.identity == (7, 1)
    assert world.vehicle.system_id == 7
    assert world.figure('messages of others') == 4
    unknown = World()
    assert unknown.say(heartbeat(autopilot=201))
    assert unknown.vehicle.figures(unknown.at)['autopilot'] == 'type 201'


def test_an_autopilot_that_does_not_answer_timesync_gets_no_cloud_tagged() -> None:
    world = World()
    world.answers = False
    world.run(5)
    assert world.reason(1.0) == ('clock not converged', True)
    assert world.poses == []
    assert 'does not answer TIMESYNC' in world.verdict()


def tagged(world: World, stamp: int) -> bool:
    """Whether a stamp has a pose, and then the right one."""
    try:
        north = world.vehicle.tag_at(stamp, world.at).pose.translation[1]
    except PoseError:
        return False
    assert north == pytest.approx((stamp - START) / S, abs=2e-3)
    return True


def seconds_until(world: World, condition: Any) -> float:
    begin = world.now
    while not condition():
        world.run(0.1)
        for ago in (300, 730):
            tagged(world, world.now - ago * MS)
        assert world.now - begin < 20 * S
    return (world.now - begin) / S


def test_loss_and_reboot_are_told_within_3_s_and_recovered_from_within_5_s() -> None:
    world = World().run(5)
    world.silent = True
    lost = world.now
    assert seconds_until(world, lambda: 'silent' in world.verdict()) < 3
    assert world.reason(1.0) == ('link lost', True)
    seconds_until(world, lambda: world.now - lost >= 20 * S)
    world.silent = False
    back = world.now
    assert seconds_until(world, lambda: tagged(world, world.now - 200 * MS)) < 5
    assert not tagged(world, (lost + back) // 2)
    world.run(5)
    world.silent = True
    world.run(1.2)
    world.silent = False
    world.boot = world.now - S // 2
    world.intervals.clear()
    assert seconds_until(world, lambda: world.figure('clock restarts') == 1) < 3
    assert seconds_until(world, lambda: tagged(world, world.now - 200 * MS)) < 5


def test_the_wrap_of_time_boot_ms_is_flown_through() -> None:
    wrap = 2**32 * MS
    world = World(boot=START - wrap + 5 * S)
    world.boot_ms = lambda: (world.now - world.boot) // MS % 2**32  # type: ignore[method-assign]
    world.run(8)
    for ago in np.linspace(0.5, 6, 50):
        assert_allclose(world.pose_at(ago).translation[1], 8 - ago, atol=2e-3)
    assert len(world.poses) > 300


@pytest.mark.parametrize(
    'wrong',
    [
        attitude(0, (0, 0, 0, 0)),
        attitude(0, (np.nan, 0, 0, 1)),
        attitude(0, (2, 0, 0, 0)),
        position(0, np.inf),
        position(0, 0, np.nan),
    ],
)
def test_impossible_contents_are_counted_and_dropped(wrong: Any) -> None:
    world = World().run(5)
    wrong.time_boot_ms = world.boot_ms() + 5
    assert world.say(wrong)
    world.run(1)
    assert world.figure('messages malformed') == 1
    assert_allclose(world.pose_at(0.995).translation, [0, 5.005, 5], atol=2e-3)


def test_another_client_that_changes_the_rates_each_second_costs_few_poses() -> None:
    world = World().run(5)
    world.poses.clear()
    begin = world.now
    for _ in range(8):
        for message_id in (31, 32):
            world.intervals[message_id] = 500_000
        world.run(1)
    stamps = range(begin, world.now - 500 * MS, 50 * MS)
    share = np.mean([tagged(world, stamp) for stamp in stamps])
    assert share > 0.75
    world.run(12)
    assert world.verdict() == 'believing the autopilot 1/1'


def test_round_trips_that_are_too_long_name_the_remedy() -> None:
    for allowed, is_known in ((0.01, False), (0.03, True)):
        world = World(VehicleSettings(maximum_clock_error=allowed))
        world.round_trip = 45 * MS
        world.run(6)
        assert world.vehicle.clock.is_converged(world.at.ros) is is_known
        if is_known:
            assert world.pose_at(0.5)
        else:
            assert 'set maximum_clock_error to 0.030' in world.verdict()
            assert 'the quickest answers to TIMESYNC take 5' in world.verdict()
            with pytest.raises(PoseError, match=r'set maximum_clock_error to 0\.030'):
                world.pose_at(0.5)


@pytest.mark.parametrize('step', [0.3, -4.1, 3600.0])
@pytest.mark.parametrize('at', ['between exchanges', 'in an exchange'])
def test_a_step_of_the_computers_clock_is_called_that(step: float, at: str) -> None:
    world = World(VehicleSettings(maximum_clock_error=0.02))
    world.round_trip = 15 * MS
    world.run(6)
    if at == 'in an exchange':
        while not world._answers:
            world.run(0.01)
    world.ahead += round(step * S)
    verdicts = set()
    for _ in range(100):
        verdicts.add(world.run(0.2).verdict())
    assert not any('maximum_clock_error' in each or 'cable' in each for each in verdicts), verdicts
    assert world.verdict() == 'believing the autopilot 1/1'
    assert world.vehicle.tag_at(world.at.ros - 500 * MS, world.at)
