"""The camera's answers to commands, and what it tells of an image."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.navigation.camera import Camera
from ftp_dent_ros.navigation.origin import Origin
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.pose import Pose

AUTOPILOT, STATION = (1, 1), (255, 190)
CAPTURE, REQUEST = mavlink.MAV_CMD_IMAGE_START_CAPTURE, mavlink.MAV_CMD_REQUEST_MESSAGE
AHEAD = Pose.from_rpy([-np.pi / 2, 0, -np.pi / 2], [0.1, 0, 0])


class Shooting:
    """A camera, and how often it was told to shoot."""

    def __init__(self) -> None:
        self.shots, self.ready, self.boot_ms = 0, True, 5000
        self.camera = Camera(255, self._shoot)

    def _shoot(self) -> bool:
        self.shots += self.ready
        return self.ready

    def say(self, number: int, *given: float, source: Any = STATION, target: int = 100) -> list:
        parameters = [*given, *(7 - len(given)) * [0]]
        message = mavlink.MAVLink_command_long_message(1, target, number, 0, *parameters)
        data = message.pack(mavlink.MAVLink(None, *source))
        (heard,) = mavlink.MAVLink(None).parse_buffer(data)
        answers = self.camera.answers(heard, AUTOPILOT, (640, 480), self.boot_ms)
        for answer in answers:
            answer.pack(mavlink.MAVLink(None, 1, 100))  # it can be sent
        return answers

    def result(self, *command: float, **options: Any) -> int:
        (ack,) = self.say(*command, **options)
        assert (ack.target_system, ack.target_component) == options.get('source', STATION)
        return ack.result


@pytest.mark.parametrize('source', [STATION, AUTOPILOT])
@pytest.mark.parametrize('target', [100, 0])
def test_one_image_is_taken_for_one_command(source, target) -> None:
    it = Shooting()
    for sequence in (1, 2):
        for _ in range(2):  # sent again, for its answer was lost
            accepted = it.result(CAPTURE, 0, 0, 1, sequence, source=source, target=target)
            assert accepted == mavlink.MAV_RESULT_ACCEPTED
    assert it.shots == 2


def test_after_a_reboot_the_autopilot_counts_anew() -> None:
    it = Shooting()
    for it.boot_ms in (60_000, 61_000, 5000, 20_000):
        assert it.result(CAPTURE, 0, 0, 1, 1, source=AUTOPILOT) == mavlink.MAV_RESULT_ACCEPTED
    assert it.shots == 3


DIGICAM = mavlink.MAV_CMD_DO_DIGICAM_CONTROL


def test_ardupilots_older_driver_shoots_with_digicam_control() -> None:
    it = Shooting()
    accepted = it.result(DIGICAM, 0, 0, 0, 0, 1, source=AUTOPILOT, target=0)
    assert accepted == mavlink.MAV_RESULT_ACCEPTED
    # Without the shot it is about zoom and focus; of the ground station to all, the autopilot's.
    assert it.say(DIGICAM, 0, 3, source=AUTOPILOT, target=0) == []
    assert it.say(DIGICAM, 0, 0, 0, 0, 1, source=STATION, target=0) == []
    assert it.result(DIGICAM, 0, 0, 0, 0, 1, source=STATION) == mavlink.MAV_RESULT_ACCEPTED
    assert it.shots == 2


def test_a_series_is_denied_and_an_absent_camera_told() -> None:
    it = Shooting()
    assert it.result(CAPTURE, 0, 1.0, 0) == mavlink.MAV_RESULT_DENIED
    it.ready = False
    assert it.result(CAPTURE, 0, 0, 1, 3) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    it.ready = True
    assert it.result(CAPTURE, 0, 0, 1, 3) == mavlink.MAV_RESULT_ACCEPTED
    assert it.shots == 1


@pytest.mark.parametrize('given', [{'source': (7, 190)}, {'source': (1, 50)}, {'target': 154}])
def test_strangers_and_what_is_for_others_are_not_answered(given) -> None:
    it = Shooting()
    assert it.say(CAPTURE, 0, 0, 1, 1, **given) == []
    assert it.shots == 0


INFORMATION, STATUS = (
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS,
)


@pytest.mark.parametrize(
    ('asking', 'counting'), [((REQUEST, 259), (REQUEST, 262)), ((INFORMATION, 1), (STATUS, 1))]
)
def test_it_says_what_it_is_and_how_many_images_it_has_taken(asking, counting) -> None:
    it = Shooting()
    ack, information = it.say(*asking)
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert bytes(information.vendor_name).rstrip(b'\0') == b'ftp_dent_ros'
    assert (information.resolution_h, information.resolution_v) == (640, 480)
    assert information.flags == mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE
    assert information.time_boot_ms == 5000
    it.camera.captured(10**18, None, AHEAD, None)
    ack, status = it.say(*counting)
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert (status.image_count, status.image_status) == (1, 0)


def test_of_an_image_it_tells_where_and_how_it_was_taken() -> None:
    # Nose east and 30 degrees up, 4 m north, 3 m up.
    tag = Tag(
        Pose(Rotation.from_euler('y', -30, degrees=True), np.array([0, 4.0, 3.0])),
        np.eye(6),
        2**32 * 1_000_000 + 7_654_321,
    )
    camera = Shooting().camera
    image = camera.captured(1_800_000_000_123_456_789, tag, AHEAD, Origin(47.45, 8.56, 430.0))
    assert image.time_boot_ms == 7
    assert image.time_utc == 1_800_000_000_123_456
    assert image.lat == pytest.approx(474_500_000 + 1e7 * 4 / 111_180, abs=2)
    assert image.lon == pytest.approx(85_600_000 + 1e7 * 0.0866 / 75_390, abs=2)
    assert (image.alt, image.relative_alt) == (433_050, 3050)
    turn = Rotation.from_quat(np.roll(image.q, -1))
    ahead = turn.apply([1, 0, 0])  # north, east, down
    assert_allclose(ahead, [0, np.cos(np.pi / 6), -0.5], atol=1e-6)
    assert_allclose(turn.apply([0, 1, 0]), [-1, 0, 0], atol=1e-6)
    assert [camera.captured(0, tag, AHEAD, None).image_index for _ in range(2)] == [1, 2]


def test_of_an_image_without_a_pose_it_says_so() -> None:
    camera = Shooting().camera
    image = camera.captured(10**18, None, AHEAD, Origin(47.45, 8.56, 430.0))
    unknown = 2**31 - 1
    assert (image.lat, image.lon, image.alt, image.relative_alt) == 4 * (unknown,)
    assert (image.time_boot_ms, image.capture_result, image.camera_id) == (0, 1, 0)
    assert np.isnan(image.q).all()
    failed = camera.captured(10**18, None, AHEAD, None, is_good=False)
    assert (failed.capture_result, failed.image_index) == (0, 1)
    assert camera.captured(10**18, None, AHEAD, None).image_index == 1
    image.pack(mavlink.MAVLink(None, 1, 100))
