"""The simulated autopilot as a process, at the other end of a real socket."""

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.spatial.transform import Rotation

from ftp_dent_ros.simulation.autopilot import main
from ftp_dent_ros.simulation.world import read_world

os.environ['MAVLINK20'] = '1'
mavutil = pytest.importorskip('pymavlink.mavutil')

START_NS = 1_700_000_000_123_456_789
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED


class Client:
    """A companion computer on a socket of its own, and the autopilot that it talks to."""

    def __init__(self, *options):
        self.link = mavutil.mavlink_connection(
            'udpin:127.0.0.1:0', source_system=1, source_component=191, dialect='ardupilotmega'
        )
        port = self.link.port.getsockname()[1]
        self.process = subprocess.Popen(
            [
                *(sys.executable, '-m', 'ftp_dent_ros.simulation.autopilot'),
                *('--address', f'udpout:127.0.0.1:{port}', '--start-ns', str(START_NS), *options),
            ]
        )

    def receive(self, kind, timeout=60.0):
        message = self.link.recv_match(type=kind, blocking=True, timeout=timeout)
        assert message is not None, f'no {kind} within {timeout} s'
        return message

    def command(self, command, *parameters):
        filled = [*parameters, *[0] * (7 - len(parameters))]
        self.link.mav.command_long_send(1, 1, command, 0, *filled)
        acknowledgement = self.receive('COMMAND_ACK')
        assert acknowledgement.command == command
        return acknowledgement.result

    def ask(self, message_id, interval_us):
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)

    def close(self):
        self.process.kill()
        self.process.wait()
        self.link.close()


@pytest.fixture
def client():
    client = Client()
    client.receive('GPS_GLOBAL_ORIGIN')  # Its first message says where it is.
    yield client
    client.close()


def test_it_is_a_quadrotor_that_sends_no_pose_unasked_and_ends_on_a_signal(client):
    seen = {}
    while 'EKF_STATUS_REPORT' not in seen:
        message = client.link.recv_match(blocking=True, timeout=60)
        seen[message.get_type()] = message
    assert not seen.keys() & {'ATTITUDE_QUATERNION', 'LOCAL_POSITION_NED'}
    heartbeat = client.receive('HEARTBEAT')
    assert heartbeat.get_srcSystem() == 1
    assert heartbeat.get_srcComponent() == 1
    assert heartbeat.type == mavlink.MAV_TYPE_QUADROTOR
    assert heartbeat.get_msgbuf()[0] == 0xFD, 'not MAVLink 2'
    assert seen['EKF_STATUS_REPORT'].flags == 0x33F
    # A late joiner gets the same clock.
    client.link.mav.timesync_send(0, 12345)
    first = client.receive('TIMESYNC')
    assert first.ts1 == 12345
    assert 60e9 <= first.tc1 < 120e9
    client.process.send_signal(signal.SIGTERM)
    assert client.process.wait(60) == 0


def test_commands_are_granted_or_denied_and_garbage_and_cut_frames_do_no_harm(client):
    accepted, denied = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
    assert client.ask(ATTITUDE, 20_000) == accepted
    assert client.ask(ATTITUDE, -1) == accepted
    assert client.ask(ATTITUDE, 2_000) == denied
    assert client.ask(ATTITUDE, math.nan) == denied
    assert client.ask(mavlink.MAVLINK_MSG_ID_ODOMETRY, 20_000) == denied
    assert client.command(mavlink.MAV_CMD_DO_REPOSITION) == mavlink.MAV_RESULT_UNSUPPORTED
    origin = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
    client.link.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, origin, *[0] * 6)
    assert client.receive('GPS_GLOBAL_ORIGIN').latitude == 474_500_000
    assert client.receive('COMMAND_ACK').result == accepted
    command = mavlink.MAVLink_command_long_message(
        1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, ATTITUDE, 20_000, 0, 0, 0, 0, 0
    ).pack(mavlink.MAVLink(None, 1, 191))
    rng = np.random.default_rng(0)
    rubbish = [rng.bytes(int(size)) for size in rng.integers(1, 300, 50)]
    rubbish += [command[:end] for end in range(1, len(command), 5)]
    rubbish += [b'\xfe' + rng.bytes(40), b'\xfd' * 300, bytes(2000)]
    for data in rubbish:
        client.link.write(data)
    huge = [math.inf, 1e30, -1e30, 3e38]
    for value in huge:
        assert client.ask(value, 20_000) == denied
    assert client.ask(ATTITUDE, 20_000) == accepted
    client.receive('ATTITUDE_QUATERNION')
    for name in ('HEARTBEAT', 'EKF_STATUS_REPORT', 'ATTITUDE_QUATERNION'):
        message_id = getattr(mavlink, f'MAVLINK_MSG_ID_{name}')
        assert client.ask(message_id, -1) == accepted
    assert client.ask(mavlink.MAVLINK_MSG_ID_HEARTBEAT, 0) == accepted
    client.receive('HEARTBEAT')


def test_poses_are_the_flights_at_their_own_time(client):
    """Pairs of equal time, 20 ms apart, each the true pose; the clock is found by TIMESYNC."""
    for message_id in (ATTITUDE, POSITION):
        assert client.ask(message_id, 20_000) == mavlink.MAV_RESULT_ACCEPTED
    attitudes, positions, offsets = {}, {}, []
    sent_ns = 0
    while len(attitudes.keys() & positions.keys()) < 50:
        if time.time_ns() - sent_ns > 50_000_000:
            sent_ns = time.time_ns()
            client.link.mav.timesync_send(0, sent_ns)
        message = client.link.recv_match(blocking=True, timeout=60)
        now = time.time_ns()
        if message.get_type() == 'ATTITUDE_QUATERNION':
            attitudes[message.time_boot_ms] = message
        elif message.get_type() == 'LOCAL_POSITION_NED':
            positions[message.time_boot_ms] = message
        elif message.get_type() == 'TIMESYNC' and message.tc1 and message.ts1 == sent_ns:
            offsets.append((now - sent_ns, (now + sent_ns) // 2 - message.tc1))
    # Attitudes begin first, while positions are asked for.
    both = {at for at in attitudes if at >= min(positions)} ^ positions.keys()
    assert both <= {max(attitudes), max(positions)}
    assert set(np.diff(sorted(attitudes))) == {20}

    round_trip, boot_ns = min(offsets)
    world = read_world('shipped:scene.yaml', START_NS)
    # The path is known at the boot clock's exact time; the offset to within half a round trip.
    slack = 1e-5 + round_trip / 2e9 * np.array([0.5, np.radians(10)])
    for boot_ms in sorted(attitudes.keys() & positions.keys()):
        stamp_ns = boot_ns + boot_ms * 1_000_000
        elapsed = (stamp_ns - world.start_ns) / 1e9
        pose = world.errors.estimated(world.flight, world.flight_time(stamp_ns), elapsed)
        position, attitude = positions[boot_ms], attitudes[boot_ms]
        east, north, up = pose.translation
        sent = np.array([position.x, position.y, position.z])
        assert np.linalg.norm(sent - [north, east, -up]) < slack[0]
        q = attitude
        body = Rotation.from_quat([q.q2, q.q3, q.q4, q.q1])
        nose = body.apply((1, 0, 0))
        right = body.apply((0, 1, 0))
        ahead, left = (pose.rotation.apply(axis) for axis in ((1, 0, 0), (0, 1, 0)))
        np.testing.assert_allclose(nose, [ahead[1], ahead[0], -ahead[2]], atol=slack[1])
        np.testing.assert_allclose(right, [-left[1], -left[0], left[2]], atol=slack[1])


def test_gps_says_where_it_truly_is_and_the_rest_what_is_estimated(client):
    for name in ('GPS_RAW_INT', 'GLOBAL_POSITION_INT'):
        message_id = getattr(mavlink, f'MAVLINK_MSG_ID_{name}')
        assert client.ask(message_id, 100_000) == mavlink.MAV_RESULT_ACCEPTED
    fix, estimate = client.receive('GPS_RAW_INT'), client.receive('GLOBAL_POSITION_INT')
    assert (fix.fix_type, fix.satellites_visible) == (3, 16)
    assert fix.time_usec % 200_000 == 0
    assert abs(fix.lat - estimate.lat) < 100 and abs(fix.alt - estimate.alt) < 200
    assert 1e-7 * fix.lat == pytest.approx(47.45 + 7.5 / 111_319, abs=1e-4)


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (('--address', 'udpin:127.0.0.1:x'), "'udpin:127.0.0.1:x' is no address: give udpout"),
        (('--address', 'udpout:127.0.0.1:70000'), 'is no address'),
        (('--address', 'udpin:192.0.2.1:14550'), 'cannot be opened'),
        (('--address', 'nowhere'), 'is no address'),
        (('--scene', 'none.yaml'), 'none.yaml'),
    ],
)
def test_a_wrong_option_is_named_in_one_line(options, words, monkeypatch, capsys):
    monkeypatch.setattr(signal, 'signal', lambda *_: None)
    assert main(options) == 2
    said = capsys.readouterr().err
    assert said.startswith('simulated_autopilot: ') and said.count('\n') == 1
    assert words in said
