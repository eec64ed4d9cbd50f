"""Addresses for a test's own links."""

from __future__ import annotations

import contextlib
import socket


def free_address() -> str:
    """HOST:PORT that is free for TCP and UDP alike: the link to the ground takes both."""
    while True:
        with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp:
            tcp.bind(('127.0.0.1', 0))
            host, port = tcp.getsockname()
            with contextlib.suppress(OSError):
                udp.bind((host, port))
                return f'{host}:{port}'
