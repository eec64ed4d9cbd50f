"""The parameters of downlink."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ftp_dent_ros.nodes.link_parameters import LinkParameters, declare_link
from ftp_dent_ros.parameters import Declarations


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


def declare(parameters: Declarations) -> DownlinkParameters:
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
