"""The connection to the autopilot: a thread that keeps it open, and a vehicle behind it.

Addresses are in pymavlink's notation.

========================  ===================================================================
`udpin:HOST:PORT`         listens on the address and answers whom it hears
`udpin:PORT`              listens on 127.0.0.1: nobody on another computer is heard
`udpout:HOST:PORT`        sends first
`tcp:HOST:PORT`           connects to a server
`/dev/ttyACM0`            serial line, with a baud rate
========================  ===================================================================
"""

from __future__ import annotations

import contextlib
import copy
import re
import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import serial
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import ConfigurationError, LinkError
from ftp_dent_ros.navigation.origin import Origin
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.navigation.report import Verdict, enum_name
from ftp_dent_ros.navigation.settings import Instant, VehicleSettings
from ftp_dent_ros.navigation.signing import Codec, is_signed
from ftp_dent_ros.navigation.vehicle import Vehicle
from ftp_dent_ros.pose import Pose

_COMPUTER = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
# Bytes of a datagram at most.
_LARGEST = 65535
# Seconds between two tries to open the link.
_PAUSE = 1.0
# A stream connection that is silent for longer may be dead without saying so; seconds.
_SILENCE = 5.0
_REFUSALS = {
    '': 'what it says is not signed, and signing_key is set: let the autopilot sign, or leave '
    'signing_key empty',
    'key': 'what it says is signed with another key: check signing_key',
    'time': 'what it says is signed with a time of the past, as after a restart without GPS time: '
    'wait until it has that',
}

Peer = tuple[str, int] | None


def parse_address(address: str) -> tuple[str, str, int]:
    """Kind (udpin, udpout, tcp or serial), host or path, and port of an address.

    Raises
    ------
    ConfigurationError
        It is none of these kinds.
    """
    if address.startswith('/'):
        return 'serial', address, 0
    address_of_port = re.sub(r'^udpin:(?=\d+$)', 'udpin:127.0.0.1:', address)
    match = re.fullmatch(r'(udpin|udpout|tcp):([\w.-]+):(\d{1,5})', address_of_port)
    if not match or not 0 < int(match[3]) < 65536:
        raise ConfigurationError(
            f'{address!r} is no address of an autopilot: give udpin:HOST:PORT, udpout:HOST:PORT, '
            'tcp:HOST:PORT or the path of a serial device'
        )
    return match[1], match[2], int(match[3])


def open_transport(address: str, baud: int) -> Transport:
    """Open a connection; LinkError if that is not possible now."""
    kind, host, port = parse_address(address)
    try:
        if kind == 'serial':
            return _Serial(host, baud)
        host = socket.gethostbyname(host)
        return _Tcp(host, port) if kind == 'tcp' else _Udp(kind == 'udpin', host, port)
    except OSError as reason:
        raise LinkError(
            f'{address}: cannot be opened ({reason.strerror or reason}): check the address, and '
            'stop another program that has it'
        ) from None


class _Udp:
    is_datagram = True

    def __init__(self, listens: bool, host: str, port: int) -> None:
        self._to: Peer = None if listens else (host, port)
        self.channel = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.channel.setblocking(False)
            # Holds more than a second of messages while the machine is busy elsewhere.
            self.channel.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            if listens:
                self.channel.bind((host, port))
        except OSError:
            self.channel.close()
            raise

    def receive(self) -> tuple[bytes, Peer]:
        # An error of what found nobody comes here as well: the autopilot is not there just now.
        try:
            return self.channel.recvfrom(_LARGEST)
        except (BlockingIOError, ConnectionError):
            return b'', None

    def send(self, data: bytes, peer: Peer) -> None:
        to = peer or self._to
        if to is not None:
            self.channel.sendto(data, to)


class _Tcp:
    is_datagram = False

    def __init__(self, host: str, port: int) -> None:
        self.channel = socket.create_connection((host, port), timeout=2.0)
        self.channel.setblocking(False)
        self.channel.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def receive(self) -> tuple[bytes, Peer]:
        try:
            data = self.channel.recv(_LARGEST)
        except BlockingIOError:
            return b'', None
        if not data:
            raise LinkError('the autopilot closed the connection')
        return data, None

    def send(self, data: bytes, peer: Peer) -> None:
        self.channel.sendall(data)


class _Serial:
    is_datagram = False

    def __init__(self, path: str, baud: int) -> None:
        # Exclusive: two programs that read one line take each other's bytes.
        self.channel = serial.Serial(path, baud, timeout=0, write_timeout=0.2, exclusive=True)

    def receive(self) -> tuple[bytes, Peer]:
        try:
            return self.channel.read(_LARGEST), None
        except TypeError:  # of pyserial, where the line is gone
            raise LinkError('the serial line was unplugged') from None

    def send(self, data: bytes, peer: Peer) -> None:
        self.channel.write(data)


Transport = _Udp | _Tcp | _Serial


@dataclass
class Speaker:
    """One component on the link: its kind by its heartbeat, and how much it sent."""

    kind: str = 'no heartbeat'
    messages: int = 0


class Roster(dict[tuple[int, int], Speaker]):
    """All who were heard, by system and component."""

    def hear(self, message: Any) -> None:
        """Note a message."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        # Messages that the dialect does not know are of nobody. A link with more speakers is one
        # on which somebody makes them up.
        if source not in self and (source[0] == 0 or len(self) >= 64):
            return
        speaker = self.setdefault(source, Speaker())
        speaker.messages += 1
        if message.get_type() == 'HEARTBEAT':
            speaker.kind = enum_name('MAV_TYPE', message.type)
            if message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                speaker.kind += f', {enum_name("MAV_AUTOPILOT", message.autopilot)}'


@dataclass(frozen=True)
class LinkState:
    """State of the link and of the vehicle behind it.

    Attributes
    ----------
    verdict : Verdict
        The first thing that is wrong, and what to do about it.
    figures : dict of str
        All that is known, by name, in the units that are in the names.
    identity : tuple of int, or None
        System and component of the autopilot that is believed.
    clock_offset : float or None
        ROS time less the autopilot's time since boot, seconds.
    origin : Origin or None
        Where on the earth the map's origin is.
    """

    verdict: Verdict
    figures: dict[str, str]
    identity: tuple[int, int] | None
    clock_offset: float | None
    origin: Origin | None


class Link:
    """Keeps a MAVLink 2 connection and answers for the pose; safe to use from any thread.

    Heartbeats are the caller's to send (`send_heartbeat`, at 1 Hz): an autopilot must not take
    a program for alive of which only this thread is.

    Parameters
    ----------
    address : str
    baud : int
        Baud rate of a serial line.
    settings : VehicleSettings
        Whom to believe and what to ask for.
    ros_time : callable
        ROS time in nanoseconds.
    on_poses : callable, optional
        Called in the link's thread with new poses and their ROS times in nanoseconds.
    signing_key : bytes
        As of `signing.read_key`; if it has no bytes, nothing is signed and all is taken.
    on_command : callable, optional
        Called in the link's thread with each COMMAND_LONG to the vehicle's system that came from
        the vehicle's own address.

    Raises
    ------
    ConfigurationError
        The address is malformed.
    """

    def __init__(
        self,
        address: str,
        baud: int,
        settings: VehicleSettings,
        ros_time: Callable[[], int] = time.time_ns,
        on_poses: Callable[[list[tuple[int, Pose]]], None] = lambda poses: None,
        signing_key: bytes = b'',
        on_command: Callable[[Any], None] = lambda command: None,
    ) -> None:
        parse_address(address)
        self._address, self._baud = address, baud
        self._ros_time, self._on_poses = ros_time, on_poses
        self._on_command = on_command
        self._vehicle = Vehicle(settings)
        self._lock = threading.RLock()
        self._transport: Transport | None = None
        # From where the vehicle speaks, and when it last did.
        self._peer: Peer = None
        self._peer_heard = 0.0
        self._impostors = self._opened = 0
        self._codec = Codec(signing_key, settings.component_id)
        self._has_key, self._is_signing = bool(signing_key), False
        self._roster = Roster()
        self._fault = 'not opened yet'
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name='mavlink', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close the connection and end the thread."""
        self._closing.set()
        # It may hang in the search for a host's name, and then ends with the process.
        self._thread.join(5.0)

    def send_heartbeat(
        self, kind: int = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, component: int = _COMPUTER
    ) -> None:
        """Tell the autopilot that a component, by default this computer, is alive."""
        heartbeat = mavlink.MAVLink_heartbeat_message(
            type=kind,
            autopilot=mavlink.MAV_AUTOPILOT_INVALID,
            base_mode=0,
            custom_mode=0,
            system_status=mavlink.MAV_STATE_ACTIVE,
            mavlink_version=3,
        )
        self.send(heartbeat, component)

    def send(self, message: Any, component: int = _COMPUTER) -> None:
        """Send a message of a component of the vehicle's."""
        with self._lock:
            if self._transport is None:
                return
            data = self._codec.pack(message, self._vehicle.system_id, component, time.time_ns())
            # A connection that broke is found out, and mended, where it is read; what a full
            # queue does not take is as good as lost.
            with contextlib.suppress(OSError):
                self._transport.send(data, self._peer)

    def tag_at(self, stamp: int) -> Tag:
        """As `Vehicle.tag_at`, now."""
        with self._lock:
            return self._vehicle.tag_at(stamp, self._now())

    def state(self) -> LinkState:
        """State at this moment."""
        with self._lock:
            now, vehicle = self._now(), self._vehicle
            figures = {
                **vehicle.figures(now),
                'reconnections': str(max(0, self._opened - 1)),
                'messages in its name from elsewhere': str(self._impostors),
                'messages without the right signature': str(self._codec.refused),
                'bytes that are no message': str(self._codec.bad_bytes),
            }
            return LinkState(
                self._verdict(now),
                figures,
                vehicle.identity,
                vehicle.clock.offset,
                vehicle.earth.origin,
            )

    def speakers(self) -> Roster:
        """Who has been heard on the link."""
        with self._lock:
            return copy.deepcopy(self._roster)

    def _verdict(self, now: Instant) -> Verdict:
        vehicle = self._vehicle
        is_alive, is_known = vehicle.is_alive(now), vehicle.clock.is_converged(now.ros)
        refused_at, why = self._codec.refusal
        is_refused = not is_alive and time.time_ns() - refused_at < 3_000_000_000
        is_signing = is_alive and self._is_signing and not self._has_key and not is_known
        for is_so, text in (
            (bool(self._fault), self._fault),
            (is_refused, f'the autopilot is not believed: {_REFUSALS[why]}'),
            (
                vehicle.identity is None,
                f'no autopilot heard on {self._address}: check that it is on and sends there, and '
                'system_id',
            ),
            (
                is_signing,
                'the autopilot signs what it says and takes nothing that is not signed: set '
                'signing_key',
            ),
        ):
            if is_so:
                return Verdict('error', text)
        return vehicle.verdict(now)

    def _now(self) -> Instant:
        return Instant(self._ros_time(), time.monotonic())

    def _run(self) -> None:
        while not self._closing.is_set():
            self._fault = self._open_and_serve()
            self._closing.wait(_PAUSE)

    def _open_and_serve(self) -> str:
        """Serve one connection until it breaks; return why it did."""
        try:
            transport = open_transport(self._address, self._baud)
            with contextlib.closing(transport.channel):
                self._use(transport)
                try:
                    self._serve(transport)
                finally:
                    self._use(None)
        except LinkError as error:
            return str(error)
        except OSError as reason:
            return f'{self._address}: the connection broke ({reason}): check the cable'
        except Exception as error:
            # The thread outlives a defect, for without it no cloud is tagged any more.
            return f'a defect of the software ({type(error).__name__}: {error}): report it'
        return 'closed'

    def _use(self, transport: Transport | None) -> None:
        with self._lock:
            self._transport, self._peer = transport, None
            if transport is not None:
                self._codec.restart(transport.is_datagram)
                self._fault = ''
                self._opened += 1

    def _serve(self, transport: Transport) -> None:
        heard = time.monotonic()
        while not self._closing.is_set():
            # The clock is looked at every 50 ms, also while nothing comes.
            if select.select([transport.channel], [], [], 0.05)[0] and self._receive(transport):
                heard = time.monotonic()
            if not transport.is_datagram and time.monotonic() - heard > _SILENCE:
                raise LinkError(f'nothing has come for {_SILENCE:.0f} s: connecting again')
            with self._lock:
                for message in self._vehicle.requests(self._now()):
                    self.send(message)

    def _receive(self, transport: Transport) -> bool:
        """Take what has come; return whether it was anything."""
        has_come, commands = False, []
        # A flood must not stop the rest.
        for _ in range(100):
            data, peer = transport.receive()
            if not data:
                break
            has_come = True
            now = self._now()
            with self._lock:
                messages = self._codec.messages(data, time.time_ns())
                commands += [each for each in messages if self._take(each, peer, now)]
        with self._lock:
            poses = self._vehicle.new_poses(self._now())
        if poses:
            self._on_poses(poses)
        for command in commands:
            self._on_command(command)
        return has_come

    def _take(self, message: Any, peer: Peer, now: Instant) -> bool:
        """Take a message; whether it is a command of the vehicle's link, for us or all."""
        vehicle, source = self._vehicle, (message.get_srcSystem(), message.get_srcComponent())
        self._roster.hear(message)
        # After a reboot the vehicle may come back from another address, but not within a second:
        # somebody else speaks in its name.
        is_elsewhere = source == vehicle.identity and self._peer not in (None, peer)
        if is_elsewhere and now.steady - self._peer_heard < 1.0:
            self._impostors += 1
            return False
        if vehicle.receive(message, now):
            self._peer, self._peer_heard = peer, now.steady
            self._is_signing = is_signed(message)
        if message.get_type() != 'COMMAND_LONG' or vehicle.identity is None or peer != self._peer:
            return False
        to_all = message.target_system == 0 and source == vehicle.identity
        return to_all or message.target_system == vehicle.identity[0]
