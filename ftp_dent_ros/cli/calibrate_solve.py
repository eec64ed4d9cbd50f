"""``ftp-dent calibrate solve``: folders of photographs to ``rig.yaml`` and a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ftp_dent_ros.calibration.page import depth_words, write_page
from ftp_dent_ros.calibration.session import find_poses, see_poses
from ftp_dent_ros.calibration.solving import STEPS, Solution, solve
from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import progress_bar
from ftp_dent_ros.cli.board_arguments import (
    BOARD,
    sequence_arguments,
    session_of,
)
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.files import check_writable
from ftp_dent_ros.rig.rig import write_rig

ARGUMENTS = (
    argument(
        'folder',
        type=Path,
        metavar='DIR',
        help='a folder a pose, the photographs numbered as they were projected',
    ),
    argument(
        '--output', type=Path, metavar='RIG.yaml', help='rig to write; default: DIR/rig.yaml'
    ),
    argument(
        '--page', type=Path, metavar='PAGE.html', help='page to write; default: beside the rig'
    ),
    *BOARD,
    *sequence_arguments(),
)


def run(arguments: argparse.Namespace) -> int:
    """Solve, write the rig and its page, and say how good it is."""
    session = session_of(arguments, arguments.folder)
    output = arguments.output or arguments.folder / 'rig.yaml'
    page = arguments.page or output.with_suffix('.html')
    count = len(find_poses(arguments.folder))
    for path in (output, page):
        check_writable(path)
    with progress_bar('reading poses', count, 'pose') as bar:
        sights, left_out, size = see_poses(arguments.folder, session, bar.update)
    for sight in sights:
        if sight.remark:
            print(f'{sight.observation.name}: {sight.remark}')
    for sentence in left_out:
        print(f'left out: {sentence}')
    with progress_bar('solving', STEPS, 'step') as bar:
        try:
            solution = solve(
                [sight.observation for sight in sights],
                session.board,
                size,
                (session.sequence.width, session.sequence.height),
                session.baseline,
                progress=bar.update,
            )
        except CalibrationError as reason:
            hint = f' (left out before: {left_out[0]})' if left_out else ''
            raise CalibrationError(f'{arguments.folder}: {reason}{hint}') from None
    left_out += [f'{name}: {reason}' for name, reason in solution.excluded.items()]
    write_page(page, solution, left_out)
    write_rig(output, solution.rig)
    sys.stdout.write('\n'.join(_summary(solution, output, page)) + '\n')
    return 0


def _summary(solution: Solution, output: Path, page: Path) -> list[str]:
    lines = [f'{name}: {reason}' for name, reason in solution.excluded.items()]
    lines += ['', f'{"RMS, pixels":24}{"camera":>10}{"projector":>11}{"stereo":>9}']
    rows = [(f'{len(solution.estimate.poses)} poses', solution.estimate.rms())]
    if solution.held_out:
        rows.append(('held out, half by half', solution.held_out.rms))
    lines += [f'{name:24}{a:10.3f}{b:11.3f}{c:9.3f}' for name, (a, b, c) in rows]
    lines += ['', depth_words(solution)]
    lines += [f'note: {remark}' for remark in solution.remarks]
    return [*lines, f'{output}: rig {solution.rig.id}', f'{page}: residuals, coverage']
