"""The connection to the autopilot: a thread that keeps it open, and a vehicle behind it."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ftp_dent_ros.errors import LinkError
from ftp_dent_ros.navigation.pose_covariance import Tag
from ftp_dent_ros.navigation.settings import Instant, Settings
from ftp_dent_ros.navigation.signing import Codec, is_signed
from ftp_dent_ros.navigation.state import LinkState, Roster, Speaker
from ftp_dent_ros.navigation.transport import Peer, Transport, check_address, open_transport
from ftp_dent_ros.navigation.vehicle import Vehicle
from ftp_dent_ros.pose import Pose

# A vehicle that is heard from another address has been silent for as long, or is none; seconds.
_MOVING_TIME = 1.0

_COMPUTER = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
# Seconds between two looks at the clock while nothing comes.
_TICK = 0.05
# Messages that are read before the clock is looked at again: a flood must not stop the rest.
_MOST_AT_ONCE = 100
# Seconds between two tries to open the link, doubled from the one to the other.
_SHORTEST_WAIT, _LONGEST_WAIT = 0.5, 2.0
# A stream connection that is silent for longer may be dead without saying so.
_SILENCE = 5.0
_TIME_TO_END = 5.0
# For as long it is told why messages were refused; ns.
_REFUSAL_TOLD = 3_000_000_000


class Way:
    """The address from which the vehicle speaks.

    Attributes
    ----------
    peer : tuple or None
        That address, where there is a choice.
    impostors : int
        Messages in the vehicle's name from elsewhere.
    """

    def __init__(self) -> None:
        self.impostors = 0
        self.restart()

    def restart(self) -> None:
        """A connection begins, or has ended."""
        self.peer: Peer = None
        self._heard = 0.0

    def confirm(self, peer: Peer, now: float) -> None:
        """The vehicle has spoken from there at a steady time."""
        self.peer, self._heard = peer, now

    def is_elsewhere(
        self, message: Any, vehicle: tuple[int, int] | None, peer: Peer, now: float
    ) -> bool:
        """Whether it speaks in the vehicle's name from elsewhere while that goes on speaking.

        After a reboot the vehicle may come back from another port, but not at once.
        """
        source = (message.get_srcSystem(), message.get_srcComponent())
        is_other = source == vehicle and self.peer is not None and peer != self.peer
        if not is_other or now - self._heard >= _MOVING_TIME:
            return False
        self.impostors += 1
        return True

    def is_for_us(self, command: Any, vehicle: tuple[int, int] | None, peer: Peer) -> bool:
        """Whether a command came the vehicle's way, to its system or from the autopilot to all."""
        if vehicle is None or peer != self.peer:
            return False
        source = (command.get_srcSystem(), command.get_srcComponent())
        to_all = command.target_system == 0 and source == vehicle
        return to_all or command.target_system == vehicle[0]


class Link:
    """Keeps a MAVLink 2 connection and answers for the pose; safe to use from any thread.

    Heartbeats are the caller's to send (`send_heartbeat`, at 1 Hz): an autopilot must not take
    a program for alive of which only this thread is.

    Parameters
    ----------
    address : str
        As in `transport`.
    baud : int
        Baud rate of a serial line.
    settings : Settings
        Whom to believe and what to ask for.
    ros_time : callable
        ROS time in nanoseconds.
    on_poses : callable, optional
        Called in the link's thread with new poses and their ROS times in nanoseconds.
    signing_key : bytes
        Key of `codec.read_key`; if it has no bytes, nothing is signed and all is taken.
    on_command : callable, optional
        Called in the link's thread with each COMMAND_LONG to the vehicle's system that came the
        vehicle's own way.

    Raises
    ------
    ConfigurationError
        The address is malformed. An address that cannot be opened is tried again and again.
    """

    def __init__(
        self,
        address: str,
        baud: int,
        settings: Settings,
        ros_time: Callable[[], int] = time.time_ns,
        on_poses: Callable[[list[tuple[int, Pose]]], None] = lambda poses: None,
        signing_key: bytes = b'',
        on_command: Callable[[Any], None] = lambda command: None,
    ) -> None:
        check_address(address)
        self._address, self._baud = address, baud
        self._ros_time, self._on_poses = ros_time, on_poses
        self._on_command = on_command
        self._vehicle = Vehicle(settings)
        self._lock = threading.Lock()
        self._transport: Transport | None = None
        self._way = Way()
        self._codec = Codec(signing_key, settings.component_id)
        self._has_key, self._is_signing = bool(signing_key), False
        self._roster = Roster()
        self._fault = 'not opened yet'
        self._opened = 0
        self._closing = threading.Event()
        self._waker, self._wakened = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name='mavlink', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close the connection and end the thread."""
        self._closing.set()
        with contextlib.suppress(OSError):
            self._waker.send(b'.')
        # It may hang in the search for a host's name, and then ends with the process.
        self._thread.join(_TIME_TO_END)
        self._waker.close()
        self._wakened.close()

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
            self._send(message, component)

    def tag_at(self, stamp: int) -> Tag:
        """As `Vehicle.tag_at`, now."""
        with self._lock:
            return self._vehicle.tag_at(stamp, self._now())

    def state(self) -> LinkState:
        """State at this moment."""
        with self._lock:
            refused_at, refusal = self._codec.refusal
            is_recent = time.time_ns() - refused_at < _REFUSAL_TOLD
            return LinkState(
                self._fault,
                self._vehicle.state(self._now()),
                self._codec.bad_bytes,
                max(0, self._opened - 1),
                self._codec.refused,
                self._way.impostors,
                refusal if is_recent else None,
                self._is_signing and not self._has_key,
            )

    def speakers(self) -> list[Speaker]:
        """Who has been heard on the link."""
        with self._lock:
            return self._roster.speakers()

    def _now(self) -> Instant:
        return Instant(self._ros_time(), time.monotonic())

    def _run(self) -> None:
        wait = _SHORTEST_WAIT
        while not self._closing.is_set():
            opened = self._opened
            self._fault = self._open_and_serve()
            wait = _SHORTEST_WAIT if self._opened > opened else min(2 * wait, _LONGEST_WAIT)
            self._closing.wait(wait)

    def _open_and_serve(self) -> str:
        """Serve one connection until it breaks; tell why it did."""
        try:
            with contextlib.closing(open_transport(self._address, self._baud)) as transport:
                self._use(transport)
                try:
                    self._serve(transport)
                finally:
                    self._use(None)
        except LinkError as error:
            return str(error)
        except Exception as error:
            # The thread outlives a defect, for without it no cloud is tagged any more.
            return f'a defect of the software ({type(error).__name__}: {error}): report it'
        return 'closed'

    def _use(self, transport: Transport | None) -> None:
        with self._lock:
            self._transport = transport
            self._way.restart()
            if transport is not None:
                self._codec.restart(transport.is_datagram)
                self._fault = ''
                self._opened += 1

    def _serve(self, transport: Transport) -> None:
        heard = time.monotonic()
        with selectors.DefaultSelector() as selector:
            selector.register(transport, selectors.EVENT_READ)
            selector.register(self._wakened, selectors.EVENT_READ)
            while not self._closing.is_set():
                if selector.select(_TICK) and self._receive(transport):
                    heard = time.monotonic()
                if not transport.is_datagram and time.monotonic() - heard > _SILENCE:
                    raise LinkError(f'nothing has come for {_SILENCE:.0f} s: connecting again')
                with self._lock:
                    for message in self._vehicle.requests(self._now()):
                        self._send(message)

    def _receive(self, transport: Transport) -> bool:
        """Take what has come; tell whether it was anything."""
        has_come, commands = False, []
        for _ in range(_MOST_AT_ONCE):
            data, peer = transport.receive()
            if not data:
                break
            has_come = True
            now = self._now()
            with self._lock:
                for message in self._codec.messages(data, time.time_ns()):
                    self._roster.hear(message, now.steady)
                    vehicle = self._vehicle.identity
                    if self._way.is_elsewhere(message, vehicle, peer, now.steady):
                        continue
                    if self._vehicle.receive(message, now):
                        self._way.confirm(peer, now.steady)
                        self._is_signing = is_signed(message)
                    is_command = message.get_type() == 'COMMAND_LONG'
                    if is_command and self._way.is_for_us(message, vehicle, peer):
                        commands.append(message)
        with self._lock:
            poses = self._vehicle.new_poses(self._now())
        if poses:
            self._on_poses(poses)
        for command in commands:
            self._on_command(command)
        return has_come

    def _send(self, message: Any, component: int = _COMPUTER) -> None:
        if self._transport is None:
            return
        data = self._codec.pack(message, self._vehicle.system_id, component, time.time_ns())
        # A connection that broke is found out, and mended, where it is read.
        with contextlib.suppress(LinkError):
            self._transport.send(data, self._way.peer)
