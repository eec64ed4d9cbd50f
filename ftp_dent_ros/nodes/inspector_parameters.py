"""The parameters of dent_inspector."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.dents.dent import RANGES, SmallestDent
from ftp_dent_ros.dents.rules import Rules, read_rules
from ftp_dent_ros.parameters import Declarations

TAGGED = 'tagged'


@dataclass(frozen=True)
class InspectorParameters:
    """What dent_inspector was given."""

    is_tagged: bool
    always: bool
    settings: SmallestDent
    rules: Rules | None
    list_file: str
    map_frame: str


def declare(parameters: Declarations) -> InspectorParameters:
    """Declare them."""
    default = SmallestDent()
    depths, widths = RANGES['smallest_depth'], RANGES['smallest_width']
    rules = parameters.file('rules', '', 'File of limits to judge the list by.')
    return InspectorParameters(
        is_tagged=parameters.declare(
            'source',
            'points',
            'How clouds are taken: points, each by itself, or tagged with the camera pose, so '
            'that their dents become one list in the map.',
            choices=('points', TAGGED),
        )
        == TAGGED,
        always=parameters.declare(
            'always', False, 'Whether the list is kept while nobody subscribes.'
        ),
        settings=SmallestDent(
            smallest_depth=parameters.declare(
                'smallest_depth',
                default.smallest_depth,
                'Shallower dents are not reported, metres.',
                minimum=depths[0],
                maximum=depths[1],
            ),
            smallest_width=parameters.declare(
                'smallest_width',
                default.smallest_width,
                'Narrower ones are rivets, scratches and gaps: not reported, metres.',
                minimum=widths[0],
                maximum=widths[1],
            ),
        ),
        rules=read_rules(rules) if rules else None,
        list_file=parameters.path(
            'list_file',
            '',
            'File that keeps the list over a restart; if empty it is forgotten then.',
        ),
        map_frame=parameters.declare(
            'map_frame', 'map', 'The frame that poses come in; others are refused.'
        ),
    )
