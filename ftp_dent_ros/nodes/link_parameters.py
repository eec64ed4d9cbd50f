"""The parameters of both ends of the link to the ground: downlink and ground_station."""

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


@dataclass(frozen=True)
class DownlinkParameters:
    """What downlink was given; the limit in byte/s, room in bytes."""

    link: LinkParameters
    limit: float
    folder: Path | None
    room: int
    pictures: bool
    jpeg_quality: int
    preview_columns: int
    recordings: Path


def declare_downlink(parameters: Declarations) -> DownlinkParameters:
    """Declare them."""
    spool = parameters.path(
        'spool.folder',
        '',
        'Where is kept what could not be sent yet; empty for in memory, until the node ends.',
    )
    recordings = parameters.path(
        'recordings', '~/recordings', 'Folder of the bags that the ground starts.'
    )
    return DownlinkParameters(
        link=declare_link(
            parameters,
            'drone',
            'Where the ground connects to: HOST:PORT of an interface of the drone, or 0.0.0.0 for '
            'all of them.',
        ),
        limit=parameters.declare(
            'limit',
            0.0,
            'kbit/s to a ground that are never exceeded; 0 for as much as the link carries.',
            minimum=0.0,
            maximum=1e7,
        )
        * 125,
        folder=Path(spool).expanduser() if spool else None,
        room=parameters.declare(
            'spool.size',
            1000,
            'MB that may be kept; beyond it the oldest of the least importance are dropped.',
            minimum=1,
            maximum=10**6,
        )
        * 10**6,
        pictures=parameters.declare('pictures', True, "Whether the camera's pictures are sent."),
        jpeg_quality=parameters.declare(
            'jpeg_quality', 85, 'Quality of the pictures.', minimum=10, maximum=100
        ),
        preview_columns=parameters.declare(
            'preview_columns',
            160,
            'Largest width of the small clouds that go first, points.',
            minimum=16,
            maximum=1920,
        ),
        recordings=Path(recordings).expanduser(),
    )


@dataclass(frozen=True)
class GroundParameters:
    """What ground_station was given."""

    link: LinkParameters
    station: str
    web: str


def declare_ground(parameters: Declarations) -> GroundParameters:
    """Declare them."""
    return GroundParameters(
        link=declare_link(
            parameters,
            'ground',
            'The drone: HOST:PORT that its downlink listens on; with tcp/ before it where no '
            'datagrams pass.',
        ),
        station=parameters.declare(
            'station',
            '',
            "Name of this ground, other than any other's of the drone; the machine's by default.",
        ),
        web=parameters.declare(
            'web',
            '',
            "HOST:PORT of the page for browsers and of Foxglove's WebSocket; empty for none.",
        ),
    )
