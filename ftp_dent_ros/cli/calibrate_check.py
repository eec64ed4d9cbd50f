"""``ftp-dent calibrate check``: whether a rig still holds, from one photograph."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from ftp_dent_ros.calibration.rig_check import adjusted, check, check_by_board
from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number
from ftp_dent_ros.cli.board_arguments import BOARD, board_of
from ftp_dent_ros.errors import ConfigurationError, RefusedFrameError
from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.photograph.file import read_photograph
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig, write_rig

# Points are many more than the check needs.
_STRIDE = 4


ARGUMENTS = (
    argument(
        'image',
        metavar='IMAGE',
        help='photograph of a flat wall, a board or a skin under the flight pattern',
    ),
    argument('--rig', required=True, metavar='RIG.yaml', help='rig to check'),
    argument('--pattern', required=True, metavar='PATTERN.yaml'),
    argument('--skin', action='store_true', help='a smooth skin, not a wall: tells less'),
    argument(
        '--flatness',
        type=number('--flatness', 0.001),
        default=0.1,
        metavar='MM',
        help='how flat wall or board are (standard deviation at the border); default: %(default)s',
    ),
    *BOARD,
    argument(
        '--adjust', type=Path, metavar='NEW.yaml', help='write the rig with the drift taken out'
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Check, say, and adjust if it is asked for: 0 holds, 1 does not or is not known.

    A projector's turn can be taken out, a lens that has changed cannot, and what is not seen is
    not known: then nothing is written.
    """
    path = find(arguments.rig)
    if arguments.adjust and arguments.adjust.exists():
        raise ConfigurationError(
            f'{arguments.adjust}: is there, and a rig is never overwritten: give a new name'
        )
    with_board = arguments.board is not None or arguments.square is not None
    if arguments.skin and with_board:
        raise ConfigurationError('--skin and --board are both given: the photograph shows one')
    board = board_of(arguments) if with_board else None
    flatness = math.inf if arguments.skin else 1e-3 * arguments.flatness
    rig, pattern = read_rig(path), read_pattern(find(arguments.pattern))
    photograph = read_photograph(arguments.image)
    if board:
        found = check_by_board(rig, pattern, board, photograph, flatness)
        checked = f"the board's corners {found.camera_px:.2f} pixels off the camera's lens model"
    else:
        try:
            cloud = Reconstructor(rig, pattern, Settings(stride=_STRIDE)).measure(photograph).cloud
        except RefusedFrameError as reason:
            raise ConfigurationError(f'{arguments.image}: {reason}') from None
        found = check(rig, pattern, photograph, cloud.points, flatness)
        checked = f'{found.rim_points} places on the rim of the frame'
    print(f'rig {rig.id}, {checked}')
    for name, turn, deviation, drift in zip(
        ('pitch', 'yaw', 'roll'),
        np.degrees(found.turn),
        np.degrees(found.deviation),
        found.drift_px,
        strict=True,
    ):
        known = ', not known' if name in found.unknown else ''
        print(f'  {name:6}{turn:+8.3f} +- {deviation:.3f} degrees {drift:+7.2f} pixels{known}')
    print(found.sentence)
    if arguments.adjust and found.camera_holds and found.tells:
        new = adjusted(rig, found)
        write_rig(arguments.adjust, new)
        print(f'{arguments.adjust}: rig {new.id}, without a covariance: calibrate when you can')
    return 0 if found.holds and found.tells else 1
