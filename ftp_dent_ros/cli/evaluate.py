"""``ftp-dent evaluate``: the paper's simulation and tables, with least squares beside them."""

from __future__ import annotations

import argparse
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.evaluation.page import write_pages
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


def run(arguments: argparse.Namespace) -> int:
    """Measure, and write the pages: 0."""
    folder = arguments.output
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f'--output {folder} cannot be made ({error.strerror}): name another folder'
        ) from None
    with tqdm(total=steps(arguments.quick), unit='cloud', dynamic_ncols=True) as bar:
        measured = study(arguments.quick, bar.update)
    pages = write_pages(folder, measured)
    print('\n'.join(str(page) for page in pages))
    return 0
