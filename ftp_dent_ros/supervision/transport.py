"""The DDS transport that images and clouds of megabytes need, and where it may reach.

Fast DDS's own shared-memory segment holds 0.5 MB; larger messages between processes are lost.
``config/transport.xml`` makes it 128 MB, of which every participant takes the whole at once.

By itself Fast DDS listens on all interfaces, also where ROS is told to stay on this computer
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
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision.shared_memory import FOLDER, free_bytes

# What Fast DDS 2.14 reads; its newer name for it is not known to that version.
VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOOPBACK = '127.0.0.1'
_SCHEMA = 'http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles'
_MEGABYTE = 1 << 20
_SMALLEST = 4 * _MEGABYTE
_GET_ADDRESS = 0x8915  # SIOCGIFADDR of linux/sockios.h


@contextmanager
def profile(
    participants: int,
    interface: str = '',
    *,
    largest: int = 0,
    port_base: int = 0,
    environment: Mapping[str, str] = os.environ,
    shared_memory: str | os.PathLike[str] = FOLDER,
) -> Iterator[dict[str, str]]:
    """Environment variables that select the transport; none if the user has selected one.

    The shipped profile where the shared memory has room for it, else one with segments so small
    that they take up half of the room at most. Below 4 MB Fast DDS's own segments are left.

    Parameters
    ----------
    participants : int
        Processes that will take part, on this machine.
    interface : str
        Name or IPv4 address of the only interface that is used beside the loopback; all if it is
        empty, unless ROS is told to stay on this computer.
    largest : int
        Of the segments, bytes; that of the shipped profile if 0.
    port_base : int
        Where the ports of domain 0 begin; participants of other bases are not met.
    environment : mapping
        Where the user may have set the variable.
    shared_memory : path
        Where Fast DDS keeps its segments.

    Raises
    ------
    ConfigurationError
        This computer has no such interface.
    """
    addresses = _addresses(interface, environment)
    if environment.get(VARIABLE):
        yield {}
        return
    shipped = files.find('shipped:transport.xml')
    tree = ElementTree.parse(shipped)
    root = tree.getroot()
    segment, message = (_first(root, name) for name in ('segment_size', 'maxMessageSize'))
    wanted = largest or int(segment.text or 0)
    size = segment_size(wanted, participants, free_bytes(shared_memory))
    if size < _SMALLEST:
        if not addresses and not port_base:
            yield {}
            return
        _leave_segments(root)
    elif size == int(segment.text or 0) and not addresses and not port_base:
        yield {VARIABLE: str(shipped)}
        return
    else:
        segment.text = str(size)
        message.text = str(min(int(message.text or 0), size // 2))
    _confine(root, addresses)
    if port_base:
        port = _append(ElementTree.Element(''), 'port')
        _append(port, 'portBase', port_base)
        _first(root, 'rtps').insert(0, port)
    with tempfile.TemporaryDirectory(prefix='ftp_dent_ros.') as folder:
        made = Path(folder) / 'transport.xml'
        ElementTree.register_namespace('', _SCHEMA)
        tree.write(made, encoding='utf-8', xml_declaration=True)
        variables = {VARIABLE: str(made)}
        if addresses:
            # With LOCALHOST rmw adds a transport of its own, that opens all interfaces.
            variables[RANGE] = 'SUBNET'
        yield variables


def _addresses(interface: str, environment: Mapping[str, str]) -> list[str]:
    """Addresses that may be used; none for all."""
    if interface:
        return sorted({LOOPBACK, address_of(interface)})
    stays = environment.get(RANGE) == 'LOCALHOST' or environment.get('ROS_LOCALHOST_ONLY') == '1'
    return [LOOPBACK] if stays else []


def address_of(interface: str) -> str:
    """IPv4 address of an interface of this computer, by its name or that address.

    Raises
    ------
    ConfigurationError
        This computer has none of it.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            address = str(ipaddress.IPv4Address(interface))
            probe.bind((address, 0))
            return address
        except ipaddress.AddressValueError:
            pass
        except OSError:
            address = ''
        try:
            request = struct.pack('256s', interface.encode()[:15])
            return socket.inet_ntoa(fcntl.ioctl(probe, _GET_ADDRESS, request)[20:24])
        except OSError:
            names = ', '.join(name for _, name in socket.if_nameindex())
            raise ConfigurationError(
                f'{interface}: no interface of this computer has that name or IPv4 address: '
                f'give one of {names}, or the address of one'
            ) from None


def _confine(root: ElementTree.Element, addresses: Sequence[str]) -> None:
    for descriptor in root.iter(f'{{{_SCHEMA}}}transport_descriptor'):
        kind = descriptor.find(f'{{{_SCHEMA}}}type')
        if addresses and kind is not None and kind.text == 'UDPv4':
            allowed = _append(descriptor, 'interfaceWhiteList')
            for address in addresses:
                _append(allowed, 'address', address)


def _leave_segments(root: ElementTree.Element) -> None:
    """Take out of a profile what it says of segments, so that Fast DDS's own values count."""
    descriptor = _first(root, 'transport_descriptor')  # that of the shared memory
    for name in ('segment_size', 'maxMessageSize', 'port_queue_capacity'):
        for element in descriptor.findall(f'{{{_SCHEMA}}}{name}'):
            descriptor.remove(element)


def _first(root: ElementTree.Element, name: str) -> ElementTree.Element:
    return next(root.iter(f'{{{_SCHEMA}}}{name}'))


def _append(parent: ElementTree.Element, name: str, text: object = '') -> ElementTree.Element:
    element = ElementTree.SubElement(parent, f'{{{_SCHEMA}}}{name}')
    element.text = str(text)
    return element


def segment_size(wanted: int, participants: int, free: int) -> int:
    """Bytes of a segment: as wanted, halved until all of them fit into half of what is free."""
    size = wanted
    while size and size * participants > free // 2:
        size //= 2
    return size


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
