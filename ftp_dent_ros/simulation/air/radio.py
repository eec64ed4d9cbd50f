"""A simulated radio: a program between two TUN devices that delays, loses and limits packets.

``python -m ftp_dent_ros.simulation.air.radio FD FD`` carries packets between two open TUN devices
and reads new conditions, one JSON object a line, from its standard input; at its end it ends.
"""

from __future__ import annotations

import contextlib
import heapq
import json
import os
import random
import select
import sys
import time
from dataclasses import dataclass, fields

# Bytes that are read at once: no IP packet is larger.
_LARGEST_PACKET = 65536
# Packets taken from one device before the other one has its turn.
_TURN = 32


@dataclass(frozen=True)
class Conditions:
    """What happens to packets, the same both ways.

    Attributes
    ----------
    rate : float
        bit/s; 0 for no limit. What finds the buffer full is lost.
    delay, jitter : float
        Seconds from one end to the other, and what is added at random without changing the
        order.
    loss, burst : float
        Share of packets that are lost, and how many in a row on average (Gilbert's model).
    duplicate, reorder : float
        Shares of packets that come twice, and that overtake those before them.
    buffer : float
        Seconds that a packet may wait for its turn.
    outage : bool
        Whether nothing passes at all.
    """

    rate: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    burst: float = 1.0
    duplicate: float = 0.0
    reorder: float = 0.0
    buffer: float = 0.5
    outage: bool = False

    @staticmethod
    def parse(line: str) -> Conditions:
        """Conditions of a JSON object with some of the fields."""
        given = json.loads(line)
        return Conditions(
            **{each.name: given[each.name] for each in fields(Conditions) if each.name in given}
        )


class Way:
    """One direction: what was put in comes out when it is due.

    Parameters
    ----------
    seed : int
        Of the chances.
    """

    def __init__(self, seed: int) -> None:
        self.conditions = Conditions()
        self.carried = self.dropped = 0
        self._random = random.Random(seed)
        self._free_at = 0.0
        self._last_due = 0.0
        self._losing = False
        self._number = 0
        self._waiting: list[tuple[float, int, bytes]] = []

    def put(self, packet: bytes, now: float) -> None:
        """A packet enters at a time in seconds."""
        which = self.conditions
        if which.outage or self._is_lost():
            self.dropped += 1
            return
        start = max(now, self._free_at)
        if which.rate:
            if start - now > which.buffer:
                self.dropped += 1
                return
            start += 8 * len(packet) / which.rate
            self._free_at = start
        due = start + which.delay
        if which.jitter:
            due += which.jitter * self._random.random()
        if which.reorder and self._random.random() < which.reorder:
            due = start + which.delay / 2
        else:
            due = self._last_due = max(due, self._last_due)
        for _ in range(2 if which.duplicate and self._random.random() < which.duplicate else 1):
            self._number += 1
            heapq.heappush(self._waiting, (due, self._number, packet))

    def due(self, now: float) -> list[bytes]:
        """Packets that come out by now, in their order."""
        out = []
        while self._waiting and self._waiting[0][0] <= now:
            out.append(heapq.heappop(self._waiting)[2])
        if self.conditions.outage:
            self.dropped += len(out)
            return []
        self.carried += sum(map(len, out))
        return out

    @property
    def next_due(self) -> float:
        """When the next packet comes out; infinity for none."""
        return self._waiting[0][0] if self._waiting else float('inf')

    def _is_lost(self) -> bool:
        share, length = self.conditions.loss, max(self.conditions.burst, 1.0)
        if not share:
            return False
        # A burst ends with 1/length; it begins so often that the share of lost ones is right.
        if self._losing:
            self._losing = self._random.random() >= 1 / length
        else:
            self._losing = self._random.random() < share / (length * (1 - share))
        return self._losing


def carry(devices: tuple[int, int], control: int) -> None:
    """Carry packets between two TUN devices until `control` (lines of conditions) ends."""
    ways = Way(1), Way(2)
    ends = {devices[0]: (ways[0], devices[1]), devices[1]: (ways[1], devices[0])}
    for device in devices:
        os.set_blocking(device, False)
    rest = b''
    while True:
        wait = min(way.next_due for way in ways) - time.monotonic()
        ready, _, _ = select.select([*devices, control], [], [], min(max(wait, 0.0), 0.5))
        if control in ready:
            more = os.read(control, 1 << 16)
            if not more:
                return
            *lines, rest = (rest + more).split(b'\n')
            for line in lines:
                ways[0].conditions = ways[1].conditions = Conditions.parse(line.decode())
        now = time.monotonic()
        for device in devices:
            if device in ready:
                _take(device, ends[device][0], now)
        for way, to in ends.values():
            for packet in way.due(time.monotonic()):
                with contextlib.suppress(OSError):  # an end that is gone
                    os.write(to, packet)


def _take(device: int, way: Way, now: float) -> None:
    with contextlib.suppress(OSError):  # no more, or an end that is gone
        for _ in range(_TURN):
            way.put(os.read(device, _LARGEST_PACKET), now)


if __name__ == '__main__':
    carry((int(sys.argv[1]), int(sys.argv[2])), sys.stdin.fileno())
