"""A graph of its own: a ROS domain and ports that nothing else meets."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision import transport

# DDS counts ports from 7400, 250 a domain, of which a participant takes the next two: half a
# domain higher nobody is met who has chosen a domain of the same number.
PORT_BASE = 7400 + 125
_PORTS = 250
_MEGABYTE = 1 << 20


@contextmanager
def free_domain(participants: int = 8, largest: int = 128 * _MEGABYTE) -> Iterator[int]:
    """Put this process and those that it starts into a graph of their own, on the loopback.

    Nothing of it is seen on a network. Its ports are not those of ROS, so that whoever takes the
    same domain, now or later, does not meet it; the kernel holds the domain's number for us, for
    all users and folders of this machine; and a domain whose ports are still in use, by what a
    killed run has left, is not taken.

    Parameters
    ----------
    participants : int
        Processes that will take part.
    largest : int
        Of their segments of shared memory, bytes.

    Yields
    ------
    int
        The domain's number.

    Raises
    ------
    ConfigurationError
        All domains are taken.
    """
    # Beyond 100 the ports reach the ephemeral ones of Linux.
    for domain in range(1, 101):
        try:
            lock = exclusive(f'domain/{domain}')
        except OSError:
            continue
        with lock:
            if _is_used(domain):
                continue
            base = {'ROS_DOMAIN_ID': str(domain), transport.RANGE: 'LOCALHOST'}
            # A user's own profile would let others in.
            made = transport.profile(
                participants, largest=largest, port_base=PORT_BASE, environment=base
            )
            with made as variables, transport.environment_of({**base, **variables}):
                yield domain
            return
    raise ConfigurationError(
        'all ROS domains from 1 to 100 are taken by other runs on this machine: end some of them'
    )


def exclusive(name: str) -> socket.socket:
    """Something that only one process of this machine holds, and gives up however it ends.

    A socket without a file: unlike a lock on a file it is the same for every user and temporary
    folder, and ends where the network ends that DDS would meet others in.

    Raises
    ------
    OSError
        Another holds it.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f'\0ftp_dent_ros/{name}')
    except OSError:
        holder.close()
        raise
    return holder


def _is_used(domain: int) -> bool:
    """Whether some process, of any user, has one of the domain's ports."""
    first = PORT_BASE + _PORTS * domain
    ports = set()
    for table in ('/proc/net/udp', '/proc/net/udp6'):
        try:
            lines = Path(table).read_text().splitlines()[1:]
        except OSError:
            continue
        ports |= {int(line.split()[1].rpartition(':')[2], 16) for line in lines}
    return not ports.isdisjoint(range(first, first + _PORTS // 2))
