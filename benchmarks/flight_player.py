"""Plays a recorded flight as the vehicle itself would: its packets at their times, and answers.

Everything in the log, of whatever system, goes out as it is.
"""

from __future__ import annotations

import copy
import random
import select
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded_flight import VEHICLE, Flight, answer


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
