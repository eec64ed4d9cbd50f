"""The arguments that describe a board and what is projected on it."""

from __future__ import annotations

import argparse
import re
from dataclasses import asdict
from pathlib import Path

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.sequence import Sequence
from ftp_dent_ros.calibration.session import FILE, Session, read_session
from ftp_dent_ros.cli import Argument, argument
from ftp_dent_ros.errors import ConfigurationError

# Of the board; lengths are in millimetres, as on a ruler.
BOARD = (
    argument('--board', metavar='CxR', help='inner corners along x and y, as 10x7'),
    argument('--square', type=float, metavar='MM', help='side of a square'),
    argument(
        '--charuco', default='', metavar='DICT', help='dictionary of a ChArUco board, DICT_5X5_250'
    ),
    argument('--marker', type=float, default=0.0, metavar='MM', help='side of a marker'),
    argument('--legacy', action='store_true', help='ChArUco board made before OpenCV 4.6'),
)


def sequence_arguments(period: int | None = None) -> tuple[Argument, ...]:
    """What is projected on the board, by default with fringes of a period, and the tape's."""
    return (
        argument('--projector', metavar='WxH', help="the projector's pixels, as 1280x720"),
        argument(
            '--period',
            type=int,
            default=period,
            metavar='PX',
            help='of shifted fringes; 0: Gray codes alone',
        ),
        argument('--steps', type=int, metavar='N', help='photographs a period'),
        argument(
            '--baseline',
            type=float,
            default=0.0,
            metavar='MM',
            help='distance between the lenses by the tape: the check that squares have the size '
            'given',
        ),
    )


def session_of(arguments: argparse.Namespace, folder: Path | None = None) -> Session:
    """What the arguments say, and the folder's ``calibration.yaml`` where they say nothing.

    Raises
    ------
    ConfigurationError
        Board or projector are described nowhere.
    """
    known = read_session(folder) if folder and (folder / FILE).is_file() else None
    baseline = 1e-3 * arguments.baseline or (known.baseline if known else 0.0)
    return Session(board_of(arguments, known), _sequence(arguments, known), baseline)


def board_of(arguments: argparse.Namespace, known: Session | None = None) -> Board:
    """The board that the arguments describe, or else the known one; raises as `session_of`."""
    if arguments.board is None and arguments.square is None and known:
        return known.board
    if arguments.board is None or arguments.square is None:
        raise ConfigurationError(
            'the board is not known: give --board with its inner corners (10x7) and --square with '
            'the side of a square in millimetres, measured on the print'
        )
    columns, rows = _pair('--board', arguments.board)
    return Board(
        columns,
        rows,
        1e-3 * arguments.square,
        arguments.charuco,
        1e-3 * arguments.marker,
        arguments.legacy,
    )


def _sequence(arguments: argparse.Namespace, known: Session | None) -> Sequence:
    # Photographs of another tool's are Gray codes, unless they say what they are.
    values = asdict(known.sequence) if known else {'period': 0}
    if arguments.projector is not None:
        values['width'], values['height'] = _pair('--projector', arguments.projector)
    values |= {
        name: getattr(arguments, name)
        for name in ('period', 'steps')
        if getattr(arguments, name) is not None
    }
    if 'width' not in values:
        raise ConfigurationError(
            "the projector's size is not known: give --projector, as 1280x720"
        )
    return Sequence(**values)


def _pair(option: str, text: str) -> tuple[int, int]:
    found = re.fullmatch(r'(\d{1,5})[x×X](\d{1,5})', text)
    if not found:
        raise ConfigurationError(f'{option} is {text!r}: give two whole numbers, as 10x7')
    return int(found.group(1)), int(found.group(2))
