"""Real connections of each kind, and what becomes of them when they break."""

from __future__ import annotations

import os
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hovering_autopilot import HoveringAutopilot, Wire
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import ConfigurationError, PoseError
from ftp_dent_ros.navigation.link import Link, parse_address
from ftp_dent_ros.navigation.settings import VehicleSettings

LOCAL = '127.0.0.1'
UNSIGNED = 'messages without the right signature'


class Subject:
    """A link, and waiting for what becomes of it."""

    def __init__(self, address: str, key: bytes = b'') -> None:
        self._news = threading.Event()
        self.poses: list[Any] = []
        self.port = 0  # that it listens on, where no address is given
        self.link = Link(address, 115200, VehicleSettings(), on_poses=self._take, signing_key=key)

    def _take(self, poses: list[Any]) -> None:
        self.poses += [pose for _, pose in poses]
        self._news.set()

    def until(self, condition: Callable[[], Any], timeout: float = 60.0) -> Any:
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            self._news.clear()
            result = condition()
            if result:
                return result
            self._news.wait(0.02)
        pytest.fail(f'not reached within {timeout:g} s; the link is {self.link.state()}')

    def text(self) -> str:
        return self.link.state().verdict.text

    def is_open(self) -> bool:
        """Whether the connection is open, before anybody is heard."""
        return self.text().startswith('no autopilot heard on')

    def figure(self, name: str) -> int:
        return int(self.link.state().figures[name])

    def north(self) -> float | None:
        """Where the vehicle was 50 ms ago, if that is known."""
        try:
            return float(self.link.tag_at(time.time_ns() - 300_000_000).pose.translation[1])
        except PoseError:
            return None

    def has_pose(self, north: float = 3.0) -> bool:
        return self.north() == pytest.approx(north)


@pytest.fixture
def connect() -> Iterator[Callable[..., Subject]]:
    subjects: list[Subject] = []

    def make(address: str = '', key: bytes = b'') -> Subject:
        with udp() as probe:
            port = probe.getsockname()[1]
        subjects.append(Subject(address or f'udpin:{port}', key))
        subjects[-1].port = port
        return subjects[-1]

    yield make
    for subject in subjects:
        subject.link.close()


def udp() -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind((LOCAL, 0))
    return end


def flying(port: int, **options: Any) -> HoveringAutopilot:
    """An autopilot that sends there from a port of its own."""
    return HoveringAutopilot(Wire(udp(), (LOCAL, port)), **options)


def listener(port: int = 0) -> socket.socket:
    server = socket.socket()
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    server.bind((LOCAL, port))
    server.listen()
    server.settimeout(60)
    return server


def test_listening_for_an_autopilot_that_sends(connect) -> None:
    subject = connect()
    with flying(subject.port) as autopilot:
        subject.until(subject.has_pose)
        subject.link.send_heartbeat()
        heartbeat = subject.until(lambda: autopilot.heard('HEARTBEAT'))[0]
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (1, 191)
    assert heartbeat.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_INVALID
    assert {m.get_msgbuf()[0] for m in autopilot.received} == {0xFD}  # MAVLink 2
    assert subject.figure('messages lost') == subject.figure('bytes that are no message') == 0


def test_sending_first_to_an_autopilot_that_listens(connect) -> None:
    end = udp()
    subject = connect(f'udpout:{LOCAL}:{end.getsockname()[1]}')
    with HoveringAutopilot(Wire(end)):
        subject.until(subject.is_open)
        subject.link.send_heartbeat()
        subject.until(subject.has_pose)


def test_tcp_that_nobody_serves_or_that_breaks_is_told_and_tried_again(connect) -> None:
    with listener() as server:
        port = server.getsockname()[1]
    subject = connect(f'tcp:{LOCAL}:{port}')
    subject.until(lambda: 'refused' in subject.text())
    with listener(port) as server:
        with HoveringAutopilot(Wire(server.accept()[0])):
            subject.until(subject.has_pose)
        subject.until(lambda: 'closed the connection' in subject.text())
        with HoveringAutopilot(Wire(server.accept()[0]), north=7.0):
            subject.until(lambda: subject.has_pose(7.0))
    assert subject.figure('reconnections') == 1


def test_a_serial_line(connect) -> None:
    pytest.importorskip('serial')
    ours, its = os.openpty()
    tty.setraw(ours)
    subject = connect(os.ttyname(its))
    with HoveringAutopilot(Wire(ours)):
        subject.until(subject.has_pose)
    os.close(its)
    subject.until(lambda: 'the connection broke' in subject.text())


def test_a_port_in_use_is_told_and_taken_when_it_is_free(connect) -> None:
    with udp() as other:
        port = other.getsockname()[1]
        subject = connect(f'udpin:{LOCAL}:{port}')
        fault = subject.until(lambda: 'another program' in (f := subject.text()) and f)
        assert fault.startswith(f'udpin:{LOCAL}:{port}: ')
    subject.until(subject.is_open)
    with flying(port):
        subject.until(subject.has_pose)


def test_an_autopilot_that_reboots_comes_back_from_another_port(connect) -> None:
    subject = connect()
    with flying(subject.port, uptime=3600.0):
        subject.until(subject.has_pose)
    with flying(subject.port, north=9.0) as second:
        subject.until(lambda: subject.has_pose(9.0))
        assert second.heard('COMMAND_LONG')
    assert subject.figure('clock restarts') == 1


def test_who_speaks_in_its_name_from_elsewhere_is_not_believed(connect) -> None:
    subject = connect()
    with flying(subject.port):
        subject.until(lambda: subject.poses and subject.has_pose())
        with flying(subject.port, north=50.0, uptime=900.0) as other:
            subject.until(lambda: subject.figure('messages in its name from elsewhere') > 10)
            assert other.received == []
        assert subject.figure('clock restarts') == 0
        subject.until(subject.has_pose)
    assert {pose.translation[1] for pose in subject.poses} == {3.0}


def test_with_a_key_only_an_autopilot_that_has_it_is_believed(connect) -> None:
    key = bytes(range(32))
    subject = connect(key=key)
    with flying(subject.port, north=50.0):
        subject.until(lambda: subject.figure(UNSIGNED) > 2)
        assert subject.link.state().identity is None
        assert 'is not signed, and signing_key is set' in subject.text()
        with flying(subject.port, key=key) as true:
            subject.until(lambda: subject.poses and subject.has_pose())
            assert all(message.get_signed() for message in true.received)
        # In its name, but without its key.
        assert {pose.translation[1] for pose in subject.poses} == {3.0}


def test_an_autopilot_that_signs_is_told_of_where_no_key_is_set(connect) -> None:
    subject = connect()
    with flying(subject.port, key=bytes(range(32))) as autopilot:
        subject.until(lambda: 'signs what it says' in subject.text())
        assert 'set signing_key' in subject.text()
        assert autopilot.received == []


def test_a_signing_autopilot_that_restarts_with_a_time_long_past_is_told_of(connect) -> None:
    key = bytes(range(32))
    subject = connect(key=key)
    with flying(subject.port, uptime=3600.0, key=key):
        subject.until(subject.has_pose)
    wire = Wire(udp(), (LOCAL, subject.port))
    with HoveringAutopilot(wire, north=9.0, key=key, signed_behind=300.0):
        subject.until(
            lambda: subject.figure(UNSIGNED) > 20 and 'a time of the past' in subject.text()
        )


def test_it_knows_who_is_on_the_link(connect) -> None:
    subject = connect()
    with flying(subject.port), udp() as other:
        subject.until(subject.has_pose)
        beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
        other.sendto(beat.pack(mavlink.MAVLink(None, 255, 190)), (LOCAL, subject.port))
        subject.until(lambda: len(subject.link.speakers()) == 2)
    speakers = subject.link.speakers()
    vehicle, ground = speakers[1, 1], speakers[255, 190]
    assert vehicle.kind == 'quadrotor, ardupilotmega'
    assert vehicle.messages > 2
    assert ground.kind == 'gcs'


@pytest.mark.parametrize(
    'address',
    (
        '',
        'udpin:127.0.0.1',
        'udpin:0',
        'udpin:127.0.0.1:99999',
        'ttyACM0',
        'tcp::1',
        'udpout:a b:1',
    ),
)
def test_a_malformed_address_is_refused(address: str) -> None:
    assert parse_address('udpin:14550') == ('udpin', '127.0.0.1', 14550), 'this computer only'
    with pytest.raises(ConfigurationError, match='udpin:HOST:PORT'):
        Link(address, 115200, VehicleSettings())
