"""``ftp-dent pattern``: what is projected, as an image, and an image as what is projected."""

from __future__ import annotations

import argparse
from pathlib import Path

from ftp_dent_ros.cli import argument
from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.files import find, write_png
from ftp_dent_ros.pattern.drawn import pattern_from_image
from ftp_dent_ros.pattern.file import read_pattern, write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.file import read_photograph

ARGUMENTS = (
    argument(
        'pattern',
        metavar='PATTERN',
        help='PATTERN.yaml to draw, or a drawn PATTERN.png to read back',
    ),
    argument(
        '--output',
        type=Path,
        required=True,
        metavar='FILE',
        help='PATTERN.png, the pixels to project, or PATTERN.yaml, their numbers',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Draw the pattern, or read one back, and say what it is."""
    output = arguments.output
    if output.suffix.lower() not in ('.png', '.yaml'):
        raise PatternError(
            f'{output}: a pattern is written without loss: give a name that ends in .png or .yaml'
        )
    pattern = _read(find(arguments.pattern))
    if output.suffix.lower() == '.yaml':
        write_pattern(output, pattern)
    else:
        write_png(output, pattern.draw()[..., ::-1])
    print(f'{output}: {pattern.width}x{pattern.height} pixels, {_sentence(pattern)}')
    return 0


def _read(path: Path) -> Pattern:
    """Pattern of its file, or of an image of it."""
    if path.suffix.lower() != '.png':
        return read_pattern(path)
    photograph = read_photograph(path)
    try:
        return pattern_from_image(photograph.shown())
    except PatternError as reason:
        raise PatternError(f'{path}: {reason}') from None


def _sentence(pattern: Pattern) -> str:
    """What it shows."""
    direction = 'upright' if pattern.axis == 'u' else 'level'
    fringes = f'{direction} fringes of {pattern.period_px:g} px'
    if pattern.code == 'stripe':
        return f'{fringes}, the red one at {pattern.stripe_center_px:g}'
    text = f'{fringes}, coded by a contrast of 1 or {pattern.low_contrast:g}'
    if not pattern.row_depth:
        return text
    return (
        f'{text}, which falls by {pattern.row_depth:.0%} every {pattern.row_period_px:g} px along '
        'them'
    )
