"""A small autopilot for the other end of a real connection: hovers, and does as it is asked."""

from __future__ import annotations

import os
import select
import socket
import threading
import time
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded_flight import answer

_PERIOD = 0.02
_POSES = (
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
)


_PLACE = 474_500_000, 85_600_000, 431_000  # degrees * 1e7, millimetres


class Wire:
    """One end of a connection, of whatever kind it is."""

    def __init__(self, end: socket.socket | int, peer: tuple[str, int] | None = None) -> None:
        self._end, self._peer = end, peer

    def fileno(self) -> int:
        return self._end if isinstance(self._end, int) else self._end.fileno()

    def read(self) -> bytes:
        if isinstance(self._end, int):
            return os.read(self._end, 4096)
        if self._end.type == socket.SOCK_STREAM:
            return self._end.recv(4096)
        data, self._peer = self._end.recvfrom(4096)
        return data

    def write(self, data: bytes) -> None:
        if isinstance(self._end, int):
            os.write(self._end, data)
        elif self._end.type == socket.SOCK_STREAM:
            self._end.sendall(data)
        elif self._peer is not None:
            self._end.sendto(data, self._peer)

    def close(self) -> None:
        if isinstance(self._end, int):
            os.close(self._end)
        else:
            self._end.close()


class HoveringAutopilot:
    """Speaks MAVLink 2 on a wire from a thread of its own until it is closed."""

    def __init__(
        self,
        wire: Wire,
        system: int = 1,
        north: float = 3.0,
        uptime: float = 5.0,
        key: bytes = b'',
        estimator_flags: int = 0x33F,
        asked: bool = False,
        signed_behind: float = 0.0,
    ) -> None:
        self._flags = estimator_flags
        self._wire, self._north = wire, north
        self._boot = time.time_ns() - round(uptime * 1e9)
        self._sender = mavlink.MAVLink(wire, system, 1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        if key:
            for end in (self._sender, self._parser):
                end.signing.secret_key, end.signing.sign_outgoing = key, True
                now = time.time_ns() - round(signed_behind * 1e9)
                end.signing.timestamp = (now - 1_420_070_400 * 10**9) // 10_000
        self._asked = set(_POSES) if asked else set[int]()
        self._closing = threading.Event()
        self.received: list[Any] = []
        self.silent = False  # out of reach, while it is
        self.reports = True  # of its estimator
        self.fix_type = 3
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def say_origin(self, latitude: int = 474_500_000) -> None:
        """Tell where on the earth the map's origin is, degrees * 1e7."""
        self._sender.gps_global_origin_send(latitude, 85_600_000, 430_000)

    def close(self) -> None:
        """Power off: the wire goes dead."""
        self._closing.set()
        self._thread.join()
        self._wire.close()

    def __enter__(self) -> HoveringAutopilot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def heard(self, name: str) -> list[Any]:
        return [message for message in list(self.received) if message.get_type() == name]

    def forward(self, message: Any, system: int, component: int) -> None:
        """Bring a message of somebody else's."""
        self._wire.write(message.pack(mavlink.MAVLink(None, system, component)))

    def motion(self, boot_ms: int) -> tuple[float, ...]:
        """Position and velocity (NED) at a time since boot."""
        return self._north, 2.0, -1.0, 0.0, 0.0, 0.0

    def _run(self) -> None:
        due, tick = time.monotonic(), 0
        try:
            while not self._closing.is_set():
                left = max(0.0, due - time.monotonic())
                if select.select([self._wire], [], [], left)[0]:
                    self._listen()
                late = time.monotonic() - due
                if late >= 0:
                    self._speak(tick, round(late * 1e9))
                    due, tick = due + _PERIOD, tick + 1
        except OSError:
            pass  # The other end has gone.

    def _speak(self, tick: int, late_ns: int) -> None:
        """Send what was sampled at the tick, however long this thread had to wait for its turn."""
        if self.silent:
            return
        boot_ms = (time.time_ns() - late_ns - self._boot) // 1_000_000
        if tick % 10 == 0:
            self._sender.heartbeat_send(
                mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4
            )
            ratio = 1e-9 * (boot_ms % 1000)  # each fix and each height is tested anew
            if self.reports:
                self._sender.ekf_status_report_send(self._flags, ratio, 0, ratio, 0, 0)
            fix = self.fix_type, *_PLACE
            self._sender.gps_raw_int_send(1000 * boot_ms, *fix, 100, 100, 0, 0, 12)
        if mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION in self._asked:
            self._sender.attitude_quaternion_send(boot_ms, 1, 0, 0, 0, 0, 0, 0)
        if mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED in self._asked:
            self._sender.local_position_ned_send(boot_ms, *self.motion(boot_ms))

    def _listen(self) -> None:
        boot, data = time.time_ns() - self._boot, self._wire.read()
        for message in [] if self.silent else self._parser.parse_buffer(data) or []:
            if message.get_type() == 'BAD_DATA':
                continue  # not signed, as it should be
            self.received.append(message)
            if message.get_type() == 'COMMAND_LONG':
                self._obey(message)
            reply = answer(message, boot)
            if reply is not None:
                self._sender.send(reply)

    def _obey(self, command: Any) -> None:
        if command.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._asked.add(int(command.param1))
        elif command.param1 == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            self.say_origin()
