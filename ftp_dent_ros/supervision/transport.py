"""The DDS transport that images and clouds of megabytes need, and where it may reach.

``config/transport.xml`` has UDP alone. The shared memory of Fast DDS is faster by some
milliseconds, but a process that is killed or stands still leaves files there by which others
stand still for seconds, or hear nothing any more for good.

By itself Fast DDS listens on all interfaces, also where ROS is to stay on this computer
(``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST``): it only looks for nobody else. Confined, its
sockets are those of the interfaces that are named, and of the loopback.
"""

from __future__ import annotations

import fcntl
import ipaddress
import os
import socket
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError

# What Fast DDS 2.14 reads; its newer name for it is not known to that version.
VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
# DDS counts ports from 7400, 250 a domain, of which a participant takes the next two: half a
# domain higher nobody is met who has chosen a domain of the same number.
PORT_BASE = 7400 + 125


@contextmanager
def profile(
    interface: str = '', *, port_base: int = 0, environment: Mapping[str, str] = os.environ
) -> Iterator[dict[str, str]]:
    """Environment variables that select the transport; none if the user has selected one.

    Parameters
    ----------
    interface : str
        Name or IPv4 address of the only interface that is used beside the loopback; all if it is
        empty, unless ROS is to stay on this computer.
    port_base : int
        Where the ports of domain 0 begin; participants of other bases are not met.
    environment : mapping
        Where the user may have set the variable.

    Raises
    ------
    ConfigurationError
        This computer has no such interface.
    """
    stays = environment.get(RANGE) == 'LOCALHOST' or environment.get('ROS_LOCALHOST_ONLY') == '1'
    addresses = ['127.0.0.1'] if stays or interface else []
    if interface:
        addresses = sorted({*addresses, address_of(interface)})
    shipped = files.find('shipped:transport.xml')
    if environment.get(VARIABLE):
        yield {}
        return
    if not addresses and not port_base:
        yield {VARIABLE: str(shipped)}
        return
    text = shipped.read_text(encoding='utf-8')
    if addresses:
        allowed = ''.join(f'<address>{address}</address>' for address in addresses)
        end = '</transport_descriptor>'
        text = text.replace(end, f'<interfaceWhiteList>{allowed}</interfaceWhiteList>{end}')
    if port_base:
        text = text.replace('<rtps>', f'<rtps><port><portBase>{port_base}</portBase></port>')
    with tempfile.TemporaryDirectory(prefix='ftp_dent_ros.') as folder:
        made = Path(folder) / 'transport.xml'
        made.write_text(text, encoding='utf-8')
        # With LOCALHOST rmw adds a transport of its own, that opens all interfaces.
        yield {VARIABLE: str(made), **({RANGE: 'SUBNET'} if addresses else {})}


def address_of(interface: str) -> str:
    """IPv4 address of an interface of this computer, by its name or that address.

    Raises
    ------
    ConfigurationError
        This computer has none of it.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        with suppress(ipaddress.AddressValueError, OSError):
            address = str(ipaddress.IPv4Address(interface))
            probe.bind((address, 0))
            return address
        with suppress(OSError):
            request = struct.pack('256s', interface.encode()[:15])
            get_address = 0x8915  # SIOCGIFADDR of linux/sockios.h
            return socket.inet_ntoa(fcntl.ioctl(probe, get_address, request)[20:24])
    names = ', '.join(name for _, name in socket.if_nameindex())
    raise ConfigurationError(
        f'{interface}: no interface of this computer has that name or IPv4 address: '
        f'give one of {names}, or the address of one'
    )


@contextmanager
def environment_of(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables meanwhile, for this process and those that it starts."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def held_names(names: Sequence[str]) -> Iterator[None]:
    """Hold the names of nodes in this ROS domain of this machine meanwhile.

    Raises
    ------
    ConfigurationError
        Another payload has one of them.
    """
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    with ExitStack() as stack:
        for name in names:
            try:
                stack.enter_context(exclusive(f'node/{domain}/{name}'))
            except OSError:  # noqa: PERF203
                raise ConfigurationError(
                    f'{name} is run by another payload in the ROS domain {domain} of this '
                    'machine: end that one, or take another namespace or ROS_DOMAIN_ID'
                ) from None
        yield


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


@contextmanager
def free_domain() -> Iterator[int]:
    """Put this process and those that it starts into a graph of their own, on the loopback.

    Nothing of it is seen on a network. Its ports are not those of ROS, so that whoever takes the
    same domain, now or later, does not meet it; and the kernel holds the domain's number for us,
    for all users and folders of this machine.

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
            base = {'ROS_DOMAIN_ID': str(domain), RANGE: 'LOCALHOST'}
            # A user's own profile would let others in.
            with (
                profile(port_base=PORT_BASE, environment=base) as variables,
                environment_of({**base, **variables}),
            ):
                yield domain
            return
    raise ConfigurationError(
        'all ROS domains from 1 to 100 are taken by other runs on this machine: end some of them'
    )
