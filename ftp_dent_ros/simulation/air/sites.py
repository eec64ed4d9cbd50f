"""Two network namespaces joined by a simulated radio: the drone, and the ground.

Each has network, shared memory and loopback of its own, so that nothing but the radio joins
them. It takes root, and a kernel that allows namespaces and TUN devices.
"""

from __future__ import annotations

import fcntl
import json
import os
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from itertools import count

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation.air.radio import Conditions

# linux/if_tun.h
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_MTU = 1500
_ADDRESSES = '10.77.0.1', '10.77.0.2'
_numbers = count()


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
            for address in _ADDRESSES:
                name = f'radio{os.getpid() % 100000}{next(_numbers) % 100}'[-15:]
                devices.append(_tun(name))
                stack.callback(os.close, devices[-1])
                holder = stack.enter_context(_holder())
                _run('ip', 'link', 'set', name, 'netns', str(holder))
                site = Site(address, name, holder)
                for words in (
                    ('mount', '-t', 'tmpfs', 'tmpfs', '/dev/shm'),
                    ('ip', 'address', 'add', f'{address}/24', 'dev', name),
                    ('ip', 'link', 'set', name, 'mtu', str(_MTU), 'txqueuelen', '10000', 'up'),
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
            [sys.executable, '-m', 'ftp_dent_ros.simulation.air.radio', *map(str, devices)],
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
        fcntl.ioctl(
            device, _TUNSETIFF, struct.pack('16sH22x', name.encode(), _IFF_TUN | _IFF_NO_PI)
        )
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
