"""The parameters of ground_station."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.nodes.link_parameters import LinkParameters, declare_link
from ftp_dent_ros.parameters import Declarations


@dataclass(frozen=True)
class GroundParameters:
    """What ground_station was given."""

    link: LinkParameters
    station: str
    web: str


def declare(parameters: Declarations) -> GroundParameters:
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
