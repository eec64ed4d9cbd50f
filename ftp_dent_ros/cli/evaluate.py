"""``ftp-dent evaluate``: the paper's tables with least squares beside them, or what is found."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros.cli.inspection_arguments import output_folder
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.evaluation.page import write_page
from ftp_dent_ros.evaluation.study import steps, study


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('out/evaluation'),
        metavar='DIR',
        help='default: out/evaluation',
    )
    parser.add_argument(
        '--quick', action='store_true', help='few photographs a row: under a minute'
    )
    parser.add_argument(
        '--pod',
        action='store_true',
        help='the probability of detection instead; a run that was ended is gone on with',
    )
    parser.add_argument(
        '--dents', type=int, default=400, metavar='N', help='with --pod; default: %(default)s'
    )
    parser.add_argument(
        '--blanks',
        type=int,
        default=1000,
        metavar='N',
        help='photographs without dents, with --pod; default: %(default)s',
    )
    parser.add_argument(
        '--smallest-depth',
        type=float,
        default=0.05,
        metavar='MM',
        help='that is looked for, with --pod; default: %(default)g',
    )


def run(arguments: argparse.Namespace) -> int:
    """Measure, and write the pages: 0."""
    folder = output_folder(arguments)
    if arguments.pod:
        return _detect(arguments, folder)
    with tqdm(total=steps(arguments.quick), unit='cloud', dynamic_ncols=True, disable=None) as bar:
        measured = study(arguments.quick, bar.update)
    print(write_page(folder, measured, arguments.quick))
    return 0


def _detect(arguments: argparse.Namespace, folder: Path) -> int:
    # Few need it.
    from ftp_dent_ros.evaluation.detection import (
        TOGETHER,
        blanks_of,
        rows_of,
        run_trials,
        sentence,
        write_detection,
    )

    for name in ('dents', 'blanks'):
        if getattr(arguments, name) < 1:
            raise ConfigurationError(
                f'--{name} is {getattr(arguments, name)}: give a number above 0'
            )
    if not 0 < arguments.smallest_depth < 100:
        raise ConfigurationError(
            f'--smallest-depth is {arguments.smallest_depth:g}: give millimetres, above 0'
        )
    depth = arguments.smallest_depth / 1e3
    total = math.ceil(arguments.dents / TOGETHER) + arguments.blanks
    with tqdm(total=total, unit='photograph', dynamic_ncols=True, disable=None) as bar:
        taken = run_trials(folder, arguments.dents, arguments.blanks, depth, bar.update)
    rows, blanks = rows_of(taken), blanks_of(taken)
    page = write_detection(folder, taken, rows, blanks, depth)
    print(sentence(rows, blanks, depth))
    print(page)
    return 0
