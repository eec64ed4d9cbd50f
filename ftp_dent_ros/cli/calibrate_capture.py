"""``ftp-dent calibrate capture``: photographs of a board, pose by pose, through the nodes."""

from __future__ import annotations

import argparse
import math
import shutil
import sys
import threading
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.calibration.guidance import covered, next_pose, projector_delay
from ftp_dent_ros.calibration.observing import Observation, observe
from ftp_dent_ros.calibration.sequence import ProjectedFrame
from ftp_dent_ros.calibration.session import Session, read_session, see_poses, write_session
from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number
from ftp_dent_ros.cli.board_arguments import (
    BOARD,
    sequence_arguments,
    session_of,
)
from ftp_dent_ros.errors import CalibrationError, ConfigurationError
from ftp_dent_ros.files import write_png

if TYPE_CHECKING:
    from ftp_dent_ros.ros.photographer import Photographer


_say = partial(print, flush=True)

ARGUMENTS = (
    argument('folder', type=Path, metavar='DIR', help='where the poses go; new'),
    argument(
        '--poses', type=number('--poses', 1, kind=int), default=15, help='default: %(default)s'
    ),
    argument(
        '--resume', action='store_true', help='go on with the poses of a capture that ended early'
    ),
    argument('--namespace', default='', help="of the payload's nodes, if they have one"),
    *BOARD,
    *sequence_arguments(period=16),
)


def run(arguments: argparse.Namespace) -> int:
    """Guide through the poses: 0 if all were taken, else 1."""
    # Only here: the other steps run without ROS.
    from ftp_dent_ros.ros.photographer import Photographer
    from ftp_dent_ros.ros.session import session as ros_session

    folder = arguments.folder
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f'{folder}: is a file: give a new folder')
    if arguments.resume:
        before = read_session(folder)
    elif folder.exists() and any(folder.iterdir()):
        raise ConfigurationError(
            f'{folder}: is not empty: give a new folder, or --resume to go on with its poses'
        )
    remap = ['-r', f'__ns:={arguments.namespace}'] if arguments.namespace else []
    with (
        ros_session('calibration', remap) as (node, stop),
        closing(Photographer(node, stop)) as rig,
    ):
        size = rig.projector_size()
        if arguments.projector is None:
            arguments.projector = f'{size[0]}x{size[1]}'
        session = session_of(arguments)
        if size != (session.sequence.width, session.sequence.height):
            raise ConfigurationError(
                f'--projector is {arguments.projector}, and {size[0]}x{size[1]} pixels are '
                'projected: leave it out, or correct the pattern'
            )
        if arguments.resume and (session.board, session.sequence) != (
            before.board,
            before.sequence,
        ):
            raise ConfigurationError(
                f'{folder}: was begun with another board or sequence (its calibration.yaml '
                'says which): give the same, or a new folder'
            )
        _say('measuring the projector: point it at the board, or at a wall ...')
        delay = projector_delay(rig.show, rig.photograph, size)
        rig.delay_ns = round(1e9 * delay)
        _say(f'the projector shows an image {1e3 * delay:.0f} ms after its message')
        session = replace(session, delay=delay)
        write_session(folder, session)
        taken = _take_poses(rig, session, folder, arguments.poses, stop)
    if taken < arguments.poses:
        print(f'\n{folder}: {taken} poses of {arguments.poses}. Go on with the same and --resume')
        return 1
    print(f'\n{folder}: {taken} poses. Now: ftp-dent calibrate solve {folder}')
    return 0


def _take_poses(
    rig: Photographer, session: Session, folder: Path, wanted: int, stop: threading.Event
) -> int:
    sequence, board = session.sequence, session.board
    seen, camera_size, number = _seen_before(folder, session)
    while len(seen) < wanted and not stop.is_set():
        advice, known = next_pose(seen, board, camera_size, (sequence.width, sequence.height))
        _say(f'\npose {len(seen) + 1} of {wanted}: {advice}')
        if math.isfinite(known):
            _say(
                f'  so far: depth known to {1e3 * known:.3f} mm, '
                f'{100 * covered(seen, camera_size):.0f} % of the image covered'
            )
        _say('  Enter takes it, q ends')
        answer = sys.stdin.readline()
        if not answer or answer.strip().lower() in ('q', 'quit'):
            break
        name = f'pose_{number:02d}'
        try:
            first = rig.take(sequence.draw(ProjectedFrame('white')))
            board.find(first)  # before half a minute of photographs
            frames = tqdm(sequence.frames, desc='  photographs', leave=False, disable=None)
            photographs = {frame: rig.take(sequence.draw(frame)) for frame in frames}
            sight = observe(name, photographs, sequence, board)
        except CalibrationError as reason:
            _say(f'  refused: {reason}')
            continue
        camera_size = first.shape[1], first.shape[0]
        _keep(folder / name, session, photographs)
        number += 1
        seen.append(sight.observation)
        _say(
            f'  taken: edges {sight.blur_px:.1f} pixels soft, contrast {sight.contrast:.0f} grey '
            f'levels, moved by {sight.moved_px:.2f} pixels'
        )
        if sight.remark:
            _say(f'  note: {sight.remark}')
    return len(seen)


def _seen_before(folder: Path, session: Session) -> tuple[list[Observation], tuple[int, int], int]:
    """Poses that a capture left which ended early, their photographs' size, the next number."""
    numbers = [int(p.name[5:]) for p in folder.glob('pose_*') if p.name[5:].isdigit()]
    if not numbers:
        return [], (0, 0), 0
    _say(f'reading the {len(numbers)} poses of {folder} ...')
    sights, left_out, size = see_poses(folder, session)
    for reason in left_out:
        _say(f'  left out: {reason}')
    return [sight.observation for sight in sights], size, max(numbers) + 1


def _keep(folder: Path, session: Session, taken: dict[ProjectedFrame, NDArray[np.uint8]]) -> None:
    """Write a pose's photographs; a folder under that name is whole or not there."""
    unfinished = folder.with_name(f'.{folder.name}')
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        for number, frame in enumerate(session.sequence.frames):
            write_png(unfinished / f'{frame.name}_{number:02d}.png', taken[frame])
        unfinished.rename(folder)
    except OSError as reason:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise ConfigurationError(
            f'{folder}: cannot be written ({reason.strerror}): make room on the disk and go on '
            'with --resume; the poses before it are kept'
        ) from None
