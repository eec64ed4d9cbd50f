"""What arguments of many commands are read with: numbers in their range, folders, rules, dents."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros.cli import Argument, argument
from ftp_dent_ros.dents.dent import RANGES, SmallestDent
from ftp_dent_ros.dents.rules import read_rules
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import check_writable, find


def number(
    option: str, least: float, most: float = math.inf, kind: Callable[[str], float] = float
) -> Callable[[str], float]:
    """Type of an argument that is a number in a range; else `ConfigurationError`."""
    bounds = f'at least {least:g}' if math.isinf(most) else f'{least:g} to {most:g}'

    def read(text: str) -> float:
        value = kind(text)
        if not least <= value <= most:
            raise ConfigurationError(f'{option} is {text}: give {bounds}')
        return value

    return read


def output_folder(name: str) -> Path:
    """Type of an argument that is a folder for results, which need not be there yet.

    Raises
    ------
    ConfigurationError
        It is a file, or cannot be written.
    """
    output = Path(name)
    if output.exists() and not output.is_dir():
        raise ConfigurationError(f'--output {output} is a file: name a folder')
    check_writable(output / 'report', f'--output {output}')
    return output


def output_argument(takes: str) -> Argument:
    """The folder for results."""
    return argument(
        '--output', type=output_folder, required=True, metavar='DIR', help=f'takes {takes}'
    )


def _smallest(name: str, what: str) -> Argument:
    """A limit of the dents that are looked for, in millimetres."""
    option, (least, most) = f'--{name.replace("_", "-")}', RANGES[name]
    return argument(
        option,
        type=number(option, 1e3 * least, 1e3 * most),
        default=1e3 * getattr(SmallestDent, name),
        metavar='MM',
        help=f'{what}; default: %(default)g',
    )


RULES = argument(
    '--rules',
    type=lambda name: read_rules(find(name)),
    metavar='RULES.yaml',
    help='limits to judge the dents by',
)
SMALLEST = (
    _smallest('smallest_depth', 'shallower dents are not reported'),
    _smallest('smallest_width', 'narrower ones are rivets, scratches and gaps'),
)


def smallest_of(arguments: argparse.Namespace) -> SmallestDent:
    """The smallest dents that the arguments ask for."""
    return SmallestDent(arguments.smallest_depth / 1e3, arguments.smallest_width / 1e3)


def progress_bar(what: str, total: int | None, unit: str) -> tqdm:
    """Bar on a terminal; elsewhere nothing."""
    return tqdm(desc=what, total=total, unit=unit, dynamic_ncols=True, disable=None)
