"""Hosts by their names."""

from __future__ import annotations

import ipaddress


def is_here(host: str) -> bool:
    """Whether only this machine reaches a host: a name, or an address, in brackets or not."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host.strip('[]')).is_loopback
    except ValueError:
        return False
