"""Bytes to and from an autopilot, in pymavlink's notation.

========================  ===================================================================
`udpin:HOST:PORT`         listens on the address and answers whom it hears
`udpin:PORT`              listens on 127.0.0.1: nobody on another computer is heard
`udpout:HOST:PORT`        sends first
`tcp:HOST:PORT`           connects to a server
`/dev/ttyACM0`            serial line, with a baud rate
========================  ===================================================================
"""

from __future__ import annotations

import contextlib
import errno
import re
import socket
from abc import ABC, abstractmethod

from ftp_dent_ros.errors import ConfigurationError, LinkError

_LOOPBACK = '127.0.0.1'
# Bytes of a datagram at most, and that the kernel may keep while this process does not run.
_LARGEST = 65535
_RECEIVE_BUFFER = 1 << 20
# Seconds.
_CONNECT_TIMEOUT = 2.0
_SEND_TIMEOUT = 0.2

Peer = tuple[str, int] | None


class Transport(ABC):
    """An open connection.

    Attributes
    ----------
    is_datagram : bool
        Whether what comes at once is whole messages, rather than a piece of one stream.
    """

    is_datagram = False

    @abstractmethod
    def fileno(self) -> int:
        """Descriptor to wait on."""

    @abstractmethod
    def receive(self) -> tuple[bytes, Peer]:
        """What has come, and from whom; b'' if there is nothing more. `LinkError` if it broke."""

    @abstractmethod
    def send(self, data: bytes, peer: Peer) -> None:
        """Send to a peer, if there is a choice. `LinkError` if the connection broke."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it."""


def check_address(address: str) -> None:
    """Raise `ConfigurationError` if an address is none of these kinds."""
    if not address.startswith('/'):
        _parts(address)


def open_transport(address: str, baud: int) -> Transport:
    """Open a connection.

    Raises
    ------
    ConfigurationError
        The address is none of these kinds.
    LinkError
        It cannot be opened now.
    """
    check_address(address)
    try:
        if address.startswith('/'):
            return _Serial(address, baud)
        kind, host, port = _parts(address)
        host = socket.gethostbyname(host)
        return _Tcp(host, port) if kind == 'tcp' else _Udp(kind == 'udpin', host, port)
    except OSError as reason:
        if reason.errno == errno.EADDRINUSE:
            raise LinkError(
                f'{address}: another program listens on this port: stop it, or choose another port'
            ) from None
        what = reason.strerror or str(reason)
        raise LinkError(f'{address}: cannot be opened ({what}): check the address') from None


def _parts(address: str) -> tuple[str, str, int]:
    address_of_port = re.sub(r'^udpin:(?=\d+$)', f'udpin:{_LOOPBACK}:', address)
    match = re.fullmatch(r'(udpin|udpout|tcp):([\w.-]+):(\d{1,5})', address_of_port)
    if not match or not 0 < int(match[3]) < 65536:
        raise ConfigurationError(
            f'{address!r} is no address of an autopilot: give udpin:HOST:PORT, udpout:HOST:PORT, '
            'tcp:HOST:PORT or the path of a serial device'
        )
    return match[1], match[2], int(match[3])


class _Udp(Transport):
    is_datagram = True

    def __init__(self, listens: bool, host: str, port: int) -> None:
        self._to: Peer = None if listens else (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            # Holds more than a second of messages while the machine is busy elsewhere.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            if listens:
                self._socket.bind((host, port))
        except OSError:
            self._socket.close()
            raise

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> tuple[bytes, Peer]:
        while True:
            try:
                data, peer = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                return b'', None
            except ConnectionError:
                continue  # A datagram of ours found nobody: the autopilot is not there just now.
            except OSError as reason:
                raise LinkError(f'the UDP socket failed ({reason.strerror})') from None
            if data:
                return data, peer

    def send(self, data: bytes, peer: Peer) -> None:
        to = peer or self._to
        if to is not None:
            # What cannot be sent is as good as a datagram lost on the way.
            with contextlib.suppress(OSError):
                self._socket.sendto(data, to)

    def close(self) -> None:
        self._socket.close()


class _Tcp(Transport):
    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), timeout=_CONNECT_TIMEOUT)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> tuple[bytes, Peer]:
        try:
            data = self._socket.recv(_LARGEST)
        except BlockingIOError:
            return b'', None
        except OSError as reason:
            raise LinkError(f'the connection broke ({reason.strerror})') from None
        if not data:
            raise LinkError('the autopilot closed the connection')
        return data, None

    def send(self, data: bytes, peer: Peer) -> None:
        try:
            # A full queue is seconds of messages that nobody has read: as good as broken.
            self._socket.sendall(data)
        except OSError as reason:
            raise LinkError(f'the connection broke ({reason})') from None

    def close(self) -> None:
        self._socket.close()


class _Serial(Transport):
    def __init__(self, path: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise LinkError(
                f'{path}: serial lines need pyserial: install it (python3-serial)'
            ) from None
        # Exclusive: two programs that read one line take each other's bytes.
        self._port = serial.Serial(
            path, baud, timeout=0, write_timeout=_SEND_TIMEOUT, exclusive=True
        )

    def fileno(self) -> int:
        return int(self._port.fileno())

    def receive(self) -> tuple[bytes, Peer]:
        try:
            return self._port.read(_LARGEST), None
        except (OSError, TypeError) as reason:
            raise LinkError(f'the serial line failed ({reason})') from None

    def send(self, data: bytes, peer: Peer) -> None:
        try:
            self._port.write(data)
        except OSError as reason:
            raise LinkError(f'the serial line failed ({reason})') from None

    def close(self) -> None:
        self._port.close()
