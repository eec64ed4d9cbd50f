"""The arguments of what inspects: the smallest dents, and the folder that takes the results."""

from __future__ import annotations

import argparse
from pathlib import Path

from ftp_dent_ros.dents.dent import RANGES, SmallestDent
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import why_not_writable

_MM = 1e3


def add_settings_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the smallest dents; lengths are in millimetres."""
    default = SmallestDent()
    parser.add_argument(
        '--smallest-depth',
        type=float,
        default=default.smallest_depth * _MM,
        metavar='MM',
        help='shallower dents are not reported; default: %(default)g',
    )
    parser.add_argument(
        '--smallest-width',
        type=float,
        default=default.smallest_width * _MM,
        metavar='MM',
        help='narrower ones are rivets, scratches and gaps; default: %(default)g',
    )


def settings_of(arguments: argparse.Namespace) -> SmallestDent:
    """Settings of an inspection that the arguments ask for.

    Raises
    ------
    ConfigurationError
        A size is out of its range; it is told in millimetres, as it was given.
    """
    for name, (least, most) in RANGES.items():
        value = getattr(arguments, name)
        if not least <= value / _MM <= most:
            raise ConfigurationError(
                f'--{name.replace("_", "-")} is {value:g}: give millimetres, {least * _MM:g} to '
                f'{most * _MM:g}'
            )
    return SmallestDent(arguments.smallest_depth / _MM, arguments.smallest_width / _MM)


def output_folder(arguments: argparse.Namespace) -> Path:
    """Folder of ``--output``, which need not be there yet.

    Raises
    ------
    ConfigurationError
        It is a file, or cannot be written.
    """
    output = Path(arguments.output)
    if output.exists() and not output.is_dir():
        raise ConfigurationError(f'--output {output} is a file: name a folder')
    if why := why_not_writable(output / 'report'):
        raise ConfigurationError(
            f'--output {output} cannot be written ({why}): name another folder'
        )
    return output
