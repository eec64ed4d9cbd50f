"""``ftp-dent evaluate``: the paper's tables with least squares beside them, or what is found."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import number, output_folder, progress_bar
from ftp_dent_ros.evaluation.page import write_page
from ftp_dent_ros.evaluation.study import steps, study

ARGUMENTS = (
    argument(
        '--output',
        type=output_folder,
        default='out/evaluation',
        metavar='DIR',
        help='default: out/evaluation',
    ),
    argument('--quick', action='store_true', help='few photographs a row: under a minute'),
    argument(
        '--pod',
        action='store_true',
        help='the probability of detection instead, of many more photographs',
    ),
    argument(
        '--dents',
        type=number('--dents', 1, kind=int),
        default=400,
        metavar='N',
        help='with --pod; default: %(default)s',
    ),
    argument(
        '--blanks',
        type=number('--blanks', 1, kind=int),
        default=1000,
        metavar='N',
        help='photographs without dents, with --pod; default: %(default)s',
    ),
    argument(
        '--smallest-depth',
        type=number('--smallest-depth', 0.001, 100),
        default=0.05,
        metavar='MM',
        help='that is looked for, with --pod; default: %(default)g',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Measure, and write the pages: 0."""
    if arguments.pod:
        return _detect(arguments, arguments.output)
    with progress_bar('evaluating', steps(arguments.quick), 'cloud') as bar:
        measured = study(arguments.quick, bar.update)
    print(write_page(arguments.output, measured, arguments.quick))
    return 0


def _detect(arguments: argparse.Namespace, folder: Path) -> int:
    # Few need it.
    from ftp_dent_ros.evaluation.detection import TOGETHER, run_trials, write_detection

    depth = arguments.smallest_depth / 1e3
    total = math.ceil(arguments.dents / TOGETHER) + arguments.blanks
    with progress_bar('evaluating', total, 'photograph') as bar:
        taken = run_trials(arguments.dents, arguments.blanks, depth, bar.update)
    page, quoted = write_detection(folder, taken, depth)
    print(quoted)
    print(page)
    return 0
