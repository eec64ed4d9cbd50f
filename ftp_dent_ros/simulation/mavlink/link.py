"""The simulated autopilot's end of a MAVLink connection, which outlives whoever is at the other.

========================= ==================================================================
``udpout:HOST:PORT``      sends there first
``udpin:HOST:PORT``       listens, and answers everyone who was heard within a minute
``tcp:HOST:PORT``         connects to a server, and again when that comes back
``tcpin:HOST:PORT``       listens; who connects last is served
========================= ==================================================================
"""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from ftp_dent_ros.errors import ConfigurationError, LinkError

os.environ.setdefault('MAVLINK20', '1')
from pymavlink.dialects.v20 import ardupilotmega as mavlink

_ADDRESS = re.compile(r'(udpin|udpout|tcp|tcpin):([\w.-]+):(\d{1,5})')
# Bytes that are read at once.
_LARGEST = 65536
# A UDP peer that has said nothing for so long gets nothing more; a connection that failed is tried
# again after so long, each try no longer than that.
_FORGOTTEN_S = 60.0
_RETRY_S = 0.5
_CONNECT_S = 0.2


class Link:
    """A connection by its address.

    Parameters
    ----------
    address : str
    system_id : int
        It speaks as component 1 of this system.

    Raises
    ------
    ConfigurationError
        The address is none of the four kinds.
    LinkError
        It is taken, or cannot be reached.
    """

    def __init__(self, address: str, system_id: int) -> None:
        match = _ADDRESS.fullmatch(address)
        if not match or not 0 < int(match[3]) < 65536:
            raise ConfigurationError(
                f'{address!r} is no address: give udpout:HOST:PORT of the bridge, '
                'udpin:HOST:PORT, tcp:HOST:PORT or tcpin:HOST:PORT'
            )
        self.system_id = system_id
        self._speaker = mavlink.MAVLink(None, system_id, mavlink.MAV_COMP_ID_AUTOPILOT1)
        try:
            self._ends: _Datagrams | _Stream
            place = socket.gethostbyname(match[2]), int(match[3])
            kind = _Datagrams if match[1].startswith('udp') else _Stream
            self._ends = kind(place, listens=match[1].endswith('in'))
        except OSError as reason:
            if reason.errno == errno.EADDRINUSE:
                raise LinkError(
                    f'{address}: another program listens there: stop it, or choose another port'
                ) from None
            what = reason.strerror or str(reason)
            raise LinkError(f'{address}: cannot be opened ({what}): check the address') from None

    def send(self, message: Any) -> None:
        """Send a message to whoever is there."""
        self._ends.write(message.pack(self._speaker))
        self._speaker.seq = (self._speaker.seq + 1) % 256

    def receive(self, timeout: float) -> Iterator[Any]:
        """Whole messages that have come, waiting at most `timeout` seconds for the first."""
        ready, _, _ = select.select(self._ends.sockets(), [], [], timeout)
        for end in ready:
            for message in self._ends.read(end) or ():
                if message.get_type() != 'BAD_DATA':
                    yield message


class _Datagrams:
    def __init__(self, place: tuple[str, int], listens: bool) -> None:
        self._heard: dict[Any, float] = {} if listens else {place: float('inf')}
        self._listens = listens
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if listens:
            self._socket.bind(place)

    def sockets(self) -> list[socket.socket]:
        return [self._socket]

    def read(self, end: socket.socket) -> list[Any] | None:
        try:
            data, peer = end.recvfrom(_LARGEST)
        except OSError:
            return None  # A datagram of ours found nobody there.
        if self._listens:
            self._heard[peer] = time.monotonic()
        # A datagram holds whole messages: what is cut off does not wait for the next one.
        return _new_parser().parse_buffer(data)

    def write(self, data: bytes) -> None:
        oldest = time.monotonic() - _FORGOTTEN_S
        self._heard = {peer: last for peer, last in self._heard.items() if last > oldest}
        for peer in self._heard:
            with suppress(OSError):  # Lost, as on the air.
                self._socket.sendto(data, peer)


class _Stream:
    def __init__(self, place: tuple[str, int], listens: bool) -> None:
        self._place = place
        self._peer: socket.socket | None = None
        self._listener: socket.socket | None = None
        self._retry = 0.0
        if listens:
            self._listener = socket.create_server(place)
            self._listener.setblocking(False)
        else:
            self._adopt(socket.create_connection(place, 5.0))

    def sockets(self) -> list[socket.socket]:
        if self._peer is None and self._listener is None and time.monotonic() > self._retry:
            self._retry = time.monotonic() + _RETRY_S
            with suppress(OSError):
                self._adopt(socket.create_connection(self._place, _CONNECT_S))
        return [end for end in (self._listener, self._peer) if end is not None]

    def read(self, end: socket.socket) -> list[Any] | None:
        try:
            if end is self._listener:
                self._adopt(end.accept()[0])
                return None
            if end is not self._peer:
                return None
            data = end.recv(_LARGEST)
        except BlockingIOError:
            return None
        except OSError:
            data = b''
        if not data:
            self._drop()
            return None
        return self._parser.parse_buffer(data)

    def write(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            # Half a message would spoil the stream of one who does not read.
            if self._peer.send(data) < len(data):
                self._drop()
        except OSError:
            self._drop()

    def _adopt(self, peer: socket.socket) -> None:
        self._drop()
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer, self._parser = peer, _new_parser()

    def _drop(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None


def _new_parser() -> Any:
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    return parser
