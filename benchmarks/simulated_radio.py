"""A simulated radio between two network namespaces: it delays, loses and limits packets."""

from __future__ import annotations

import contextlib
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, fields
from itertools import count

from ftp_dent_ros.errors import ConfigurationError

# Packets taken from one device before the other one has its turn.
_TURN = 32

_numbers = count()


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


class RadioPath:
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
    ways = RadioPath(1), RadioPath(2)
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


def _take(device: int, way: RadioPath, now: float) -> None:
    with contextlib.suppress(OSError):  # no more, or an end that is gone
        for _ in range(_TURN):
            # Bytes that are read at once: no IP packet is larger.
            way.put(os.read(device, 65536), now)


@dataclass(frozen=True)
class Site:
    """One end of the radio.

    Attributes
    ----------
    address : str
        Its IPv4 address on the radio.
    interface : str
        The radio's device there.
    """

    address: str
    interface: str
    _holder: int

    def command(self, words: Sequence[str]) -> list[str]:
        """Words that run a command there."""
        return ['nsenter', '-t', str(self._holder), '-n', '-m', '--', *words]

    def traffic(self) -> tuple[int, int]:
        """Bytes that came and went over the radio so far."""
        text = subprocess.run(
            self.command(['cat', '/proc/net/dev']), check=True, capture_output=True, text=True
        ).stdout
        row = next(line for line in text.splitlines() if f'{self.interface}:' in line)
        numbers = row.split(':')[1].split()
        return int(numbers[0]), int(numbers[8])


@dataclass(frozen=True)
class Joined:
    """Both ends, and the radio between them."""

    drone: Site
    ground: Site
    _radio: subprocess.Popen[str]

    def set(self, conditions: Conditions) -> None:
        """Change the radio from now on."""
        assert self._radio.stdin is not None
        self._radio.stdin.write(json.dumps(asdict(conditions)) + '\n')
        self._radio.stdin.flush()


@contextmanager
def joined_sites(conditions: Conditions | None = None) -> Iterator[Joined]:
    """Make the two ends; at the end of the block nothing of them is left.

    Raises
    ------
    ConfigurationError
        Namespaces or TUN devices are not allowed here.
    """
    with ExitStack() as stack:
        devices, sites = [], []
        try:
            for address in ('10.77.0.1', '10.77.0.2'):
                name = f'radio{os.getpid() % 100000}{next(_numbers) % 100}'[-15:]
                devices.append(_tun(name))
                stack.callback(os.close, devices[-1])
                holder = stack.enter_context(_holder())
                _run('ip', 'link', 'set', name, 'netns', str(holder))
                site = Site(address, name, holder)
                for words in (
                    ('mount', '-t', 'tmpfs', 'tmpfs', '/dev/shm'),
                    ('ip', 'address', 'add', f'{address}/24', 'dev', name),
                    ('ip', 'link', 'set', name, 'mtu', str(1500), 'txqueuelen', '10000', 'up'),
                    ('ip', 'link', 'set', 'lo', 'up', 'multicast', 'on'),
                    ('ip', 'route', 'add', '224.0.0.0/4', 'dev', name),
                ):
                    _run(*site.command(words))
                sites.append(site)
        except (OSError, subprocess.CalledProcessError) as reason:
            raise ConfigurationError(
                f'no network namespaces with TUN devices here ({reason}): run it as root on a '
                'kernel that has them'
            ) from None
        radio = subprocess.Popen(
            [sys.executable, __file__, *map(str, devices)],
            stdin=subprocess.PIPE,
            pass_fds=devices,
            text=True,
        )
        stack.callback(radio.wait)
        stack.callback(radio.stdin.close)  # type: ignore[union-attr]
        joined = Joined(sites[0], sites[1], radio)
        joined.set(conditions or Conditions())
        yield joined


def _tun(name: str) -> int:
    device = os.open('/dev/net/tun', os.O_RDWR)
    try:
        # linux/if_tun.h
        fcntl.ioctl(device, 0x400454CA, struct.pack('16sH22x', name.encode(), 0x0001 | 0x1000))
    except OSError:
        os.close(device)
        raise
    return device


@contextmanager
def _holder() -> Iterator[int]:
    """Process id of a shell that holds a network and a mount namespace, until its input ends."""
    process = subprocess.Popen(
        ['unshare', '--net', '--mount', '--propagation', 'private', 'sh', '-c', 'echo; read _'],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        if not process.stdout.readline():
            raise OSError('unshare failed')
        yield process.pid
    finally:
        process.stdin.close()
        process.stdout.close()
        process.wait()


def _run(*words: str) -> None:
    subprocess.run(words, check=True, capture_output=True)


if __name__ == '__main__':
    carry((int(sys.argv[1]), int(sys.argv[2])), sys.stdin.fileno())
