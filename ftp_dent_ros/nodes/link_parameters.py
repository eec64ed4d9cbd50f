"""The parameters that both ends of the link to the ground have."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ftp_dent_ros.ground.link import PORT, Security, endpoints
from ftp_dent_ros.parameters import Declarations


@dataclass(frozen=True)
class LinkParameters:
    """Where and how drone and ground meet."""

    address: str
    name: str
    security: Security


def declare_link(parameters: Declarations, role: str, what: str) -> LinkParameters:
    """Declare address, keys and name; refuses an open link beyond this machine."""
    address = parameters.declare('address', f'127.0.0.1:{PORT}', what)
    keys = parameters.path(
        'keys', '', 'Folder of the keys that `ftp-dent ground --make-keys` has made.'
    )
    is_open = parameters.declare(
        'open', False, 'Whether, without keys, anybody in the network may use the link.'
    )
    name = parameters.declare('name', 'payload', 'Name of the payload: the same at both ends.')
    security = Security(Path(keys) if keys else None, is_open)
    endpoints(address, security, role)
    return LinkParameters(address, name, security)
