"""Plays a recorded flight as the vehicle itself would: its packets at their times, and answers.

A log answers nobody. The player answers TIMESYNC on the recorded vehicle's own boot clock, as
its recorded answers to another client show it, and acknowledges commands. Everything else in the
log, of whatever system, goes out as it is.
"""

from __future__ import annotations

import copy
import lzma
import random
import select
import socket
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

VEHICLE = (1, 1)
# TIMESYNC shows the recorded vehicle's clock as it was a few milliseconds before.
_STAMPED_LATER = 7_000_000
_EARTH_RADIUS, _ECCENTRICITY_SQUARED = 6378137.0, 6.69437999014e-3  # WGS 84


@dataclass
class Flight:
    """Packets of a .tlog file, packed (.xz) or not.

    Times are nanoseconds on the clock of the recording computer.
    """

    times: list[int] = field(default_factory=list)
    packets: list[bytes] = field(default_factory=list)
    messages: list[mavlink.MAVLink_message] = field(default_factory=list)

    @classmethod
    def read(cls, path: Path) -> Flight:
        data, at, flight = path.read_bytes(), 0, cls()
        if path.suffix == '.xz':
            data = lzma.decompress(data)
        parser = mavlink.MAVLink(None)
        while at < len(data):
            (microseconds,) = struct.unpack_from('>Q', data, at)
            magic, length, flags = data[at + 8 : at + 11]
            size = length + (12 + 13 * (flags & 1) if magic == 0xFD else 8)
            packet = data[at + 8 : at + 8 + size]
            (message,) = parser.parse_buffer(packet)
            flight.times.append(1000 * microseconds)
            flight.packets.append(packet)
            flight.messages.append(message)
            at += 8 + size
        flight._read_boot_clock()
        return flight

    def of(self, name: str) -> list[tuple[int, mavlink.MAVLink_message]]:
        """Messages of the vehicle's of one type, with their times."""
        return [
            (stamp, message)
            for stamp, message in zip(self.times, self.messages, strict=True)
            if message.get_type() == name
            and (message.get_srcSystem(), message.get_srcComponent()) == VEHICLE
        ]

    def _read_boot_clock(self) -> None:
        """Follow the vehicle's clock only as far as what was recorded forces it to go.

        It was read after the question was sent and before the answer came, so that an answer
        that came late says little; what the vehicle stamped came no earlier than its stamp.
        Where these bounds exclude what they were before, the clock has truly stepped or halted.
        """
        start, asked = self.times[0], dict[int, int]()
        times, behind = [0], list[int]()
        for stamp, message in zip(self.times, self.messages, strict=True):
            name = message.get_type()
            if name == 'TIMESYNC' and not message.tc1:
                asked[message.ts1] = stamp
            if (message.get_srcSystem(), message.get_srcComponent()) != VEHICLE:
                continue
            if name == 'TIMESYNC' and message.tc1 and message.ts1 in asked:
                lower, upper = asked[message.ts1] - message.tc1, stamp - message.tc1
            elif name in ('ATTITUDE_QUATERNION', 'LOCAL_POSITION_NED') and behind:
                lower, upper = -(2**63), stamp - 1_000_000 * message.time_boot_ms + _STAMPED_LATER
            else:
                continue
            behind.append(min(max(behind[-1] if behind else upper, lower), upper))
            times.append(stamp - start)
        self._clock_times = np.array(times, float)
        self._clock_behind = np.array([behind[0], *behind], float) - start

    def boot_ns(self, stamp: int) -> int:
        """The vehicle's time since boot at a time of the recording."""
        at = stamp - self.times[0]
        return int(at - np.interp(at, self._clock_times, self._clock_behind))

    def truth(self) -> Truth:
        """The simulator's own record of the flight (SIM_STATE)."""
        _, origin = self.of('GPS_GLOBAL_ORIGIN')[-1]
        records = self.of('SIM_STATE')
        states = [message for _, message in records]
        latitude = np.radians(1e-7 * origin.latitude)
        curve = 1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
        meridian = _EARTH_RADIUS * (1 - _ECCENTRICITY_SQUARED) / curve**1.5
        parallel = _EARTH_RADIUS / np.sqrt(curve) * np.cos(latitude)
        north = np.radians([1e-7 * (s.lat_int - origin.latitude) for s in states]) * meridian
        east = np.radians([1e-7 * (s.lon_int - origin.longitude) for s in states]) * parallel
        up = np.array([s.alt for s in states]) - 1e-3 * origin.altitude
        return Truth(
            [stamp for stamp, _ in records],
            np.stack([north, east, -up], axis=1),
            np.array([(s.q1, s.q2, s.q3, s.q4) for s in states]),
        )


@dataclass(frozen=True)
class Truth:
    """Where the vehicle truly was.

    Attributes
    ----------
    times : list of int
        When each record came, nanoseconds on the clock of the recording computer.
    position : ndarray, shape (n, 3)
        North, east, down from the estimator's origin, metres.
    attitude : ndarray, shape (n, 4)
        w, x, y, z; FRD -> NED.
    """

    times: list[int]
    position: np.ndarray
    attitude: np.ndarray


def answer(message: mavlink.MAVLink_message, boot_ns: int) -> mavlink.MAVLink_message | None:
    """What the vehicle sends back to a message, at a time since its boot."""
    if message.get_type() == 'TIMESYNC' and message.tc1 == 0:
        return mavlink.MAVLink_timesync_message(tc1=boot_ns, ts1=message.ts1)
    if message.get_type() == 'COMMAND_LONG':
        return mavlink.MAVLink_command_ack_message(
            message.command,
            mavlink.MAV_RESULT_ACCEPTED,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )
    return None


@dataclass(frozen=True)
class Disturbance:
    """What is wrong with the link.

    Attributes
    ----------
    loss : float
        Share of the packets that are lost, of either direction.
    burst : float
        For 0.3 s, every second or so, packets are late by up to as many seconds; in their order.
    foreign : int
        System id of another vehicle, 50 m away and turned, that sends and answers on the same
        port; 0 for none.
    """

    loss: float = 0.0
    burst: float = 0.0
    foreign: int = 0


class _Air:
    """The way of the packets to an address."""

    def __init__(
        self, end: socket.socket, address: tuple[str, int], disturbance: Disturbance
    ) -> None:
        self._end, self._address, self._disturbance = end, address, disturbance
        self._random = random.Random(1)
        self._queue: deque[tuple[float, bytes]] = deque()
        self._burst = (0.0, 0.0)

    def loses(self) -> bool:
        return self._random.random() < self._disturbance.loss

    def send(self, data: bytes) -> None:
        if self.loses():
            return
        now = at = time.monotonic()
        if now > self._burst[1]:
            begin = now + self._random.uniform(0.5, 2.0)
            self._burst = begin, begin + 0.3
        if now > self._burst[0]:
            at += self._random.uniform(0, self._disturbance.burst)
        self._queue.append((max(at, self._queue[-1][0]) if self._queue else at, data))
        self.flush()

    def flush(self) -> None:
        while self._queue and self._queue[0][0] <= time.monotonic():
            self._end.sendto(self._queue.popleft()[1], self._address)

    def wait(self, timeout: float) -> float:
        """How long may be waited before the next packet is due."""
        if not self._queue:
            return timeout
        return max(0.0, min(timeout, self._queue[0][0] - time.monotonic()))


class FlightPlayer:
    """Plays a flight in real time from a UDP socket of its own to an address.

    Parameters
    ----------
    begin, end : float
        Part of the flight to play, seconds since its start.
    disturbance : Disturbance
    """

    def __init__(
        self,
        flight: Flight,
        address: tuple[str, int],
        begin: float = 0.0,
        end: float = np.inf,
        disturbance: Disturbance | None = None,
    ) -> None:
        self._flight = flight
        stamps = np.array(flight.times) - flight.times[0]
        self._range = np.searchsorted(stamps, [begin * 1e9, min(end * 1e9, 9e18)])
        self._first = flight.times[0] + int(begin * 1e9)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', 0))
        self._sender = mavlink.MAVLink(None, *VEHICLE)
        disturbance = disturbance or Disturbance()
        self._air = _Air(self._socket, address, disturbance)
        self._other = mavlink.MAVLink(None, disturbance.foreign, 1)
        self._closing = threading.Event()
        self._begun = threading.Event()
        self.done = threading.Event()
        self.received: list[mavlink.MAVLink_message] = []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def shift(self) -> int:
        """What to add to a time of the recording to get the playback's UNIX time; ns."""
        self._begun.wait()
        return self._shift

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        self._socket.close()

    def __enter__(self) -> FlightPlayer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        self._shift = time.time_ns() - self._first
        self._begun.set()
        for index in range(*self._range):
            due = self._flight.times[index] + self._shift
            while not self._closing.is_set():
                left = (due - time.time_ns()) / 1e9
                self._answer(max(0.0, min(left, 0.1)))
                if left <= 0:
                    break
            if self._closing.is_set():
                return
            self._air.send(self._flight.packets[index])
            message = self._flight.messages[index]
            if (message.get_srcSystem(), message.get_srcComponent()) == VEHICLE:
                # An answer in between repeats the number, so that none seems to be lost.
                self._sender.seq = message.get_seq()
                if self._other.srcSystem:
                    self._send_of_other(message)
        self.done.set()
        while not self._closing.is_set():
            self._answer(0.05)

    def _send_of_other(self, message: mavlink.MAVLink_message) -> None:
        other, name = copy.copy(message), message.get_type()
        if name == 'LOCAL_POSITION_NED':
            other.x += 50
        elif name == 'ATTITUDE_QUATERNION':
            # Half a turn about the vertical.
            other.q1, other.q2 = -message.q4, -message.q3
            other.q3, other.q4 = message.q2, message.q1
        elif name not in ('HEARTBEAT', 'EKF_STATUS_REPORT', 'SYSTEM_TIME'):
            return
        self._air.send(other.pack(self._other))

    def _answer(self, timeout: float) -> None:
        self._air.flush()
        if not select.select([self._socket], [], [], self._air.wait(timeout))[0]:
            return
        try:
            data, _ = self._socket.recvfrom(65535)
        except ConnectionError:
            return
        if self._air.loses():
            return
        boot = self._flight.boot_ns(time.time_ns() - self._shift)
        for message in mavlink.MAVLink(None).parse_buffer(data) or []:
            self.received.append(message)
            if self._other.srcSystem and message.get_type() == 'TIMESYNC':
                self._air.send(answer(message, boot + 17 * 10**9).pack(self._other))
            reply = answer(message, boot)
            if reply is not None:
                self._air.send(reply.pack(self._sender))
