"""The parameters of pattern_publisher."""

from __future__ import annotations

from dataclasses import dataclass

from ftp_dent_ros.parameters import Declarations
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.rig.rig import Rig, read_rig


@dataclass(frozen=True)
class PatternParameters:
    """What pattern_publisher was given."""

    rig: Rig | None
    pattern: Pattern | None
    frame_id: str
    shows: bool
    corner: tuple[int, int]


def declare(parameters: Declarations) -> PatternParameters:
    """Declare them; ``period_px``, ``stripe_center_px`` and ``code`` change while it runs."""
    parameters.declare(
        'period_px',
        0.0,
        'Fringe period, projector pixels; 0 takes that of the pattern file.',
        minimum=0.0,
        maximum=1e4,
        changeable=True,
    )
    parameters.declare(
        'stripe_center_px',
        0.0,
        "Column of the middle of the red stripe, or where the coded fringes' phase is zero, "
        'projector pixels; 0 takes that of the '
        "pattern file or, without one, the image's middle.",
        minimum=0.0,
        maximum=65536.0,
        changeable=True,
    )
    parameters.declare(
        'code',
        'file',
        'How fringes tell which they are: stripe (the central one is red), contrast (each has its '
        'own, and no colour), or file: as the pattern file says; without one, stripe.',
        choices=('file', *CODES),
        changeable=True,
    )
    x, y = (
        parameters.declare(
            f'display.{axis}',
            0,
            f"{axis} of the display's upper left corner on the desktop, pixels.",
            minimum=-65536,
            maximum=65536,
        )
        for axis in 'xy'
    )
    rig = parameters.file('rig', '', 'Calibration file (rig.yaml).')
    pattern = parameters.file(
        'pattern',
        '',
        "Pattern file (pattern.yaml); if empty, the size is that of the rig's projector and "
        'period_px must be set.',
    )
    return PatternParameters(
        rig=read_rig(rig) if rig else None,
        pattern=read_pattern(pattern) if pattern else None,
        frame_id=parameters.declare(
            'frame_id', 'projector_optical_frame', "The projector's frame."
        ),
        shows=parameters.declare(
            'display.enabled', False, 'Show the pattern in full screen on a display.'
        ),
        corner=(x, y),
    )
