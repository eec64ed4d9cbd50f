"""``ftp-dent calibrate``: a board under projected patterns to ``rig.yaml``."""

from __future__ import annotations

import argparse
import importlib

# Each module has add_arguments(parser) and run(arguments) -> exit status.
STEPS = {
    'check': 'whether a rig still holds, from one photograph of a wall, a board or the skin',
    'capture': 'photographs of a board in many poses, through the nodes of a running payload',
    'solve': 'photographs of a board in many poses to rig.yaml and a page',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the steps and their arguments."""
    steps = parser.add_subparsers(dest='step', metavar='STEP', required=True)
    for name, summary in STEPS.items():
        sub = steps.add_parser(name, help=summary, description=summary.capitalize() + '.')
        _module(name).add_arguments(sub)


def run(arguments: argparse.Namespace) -> int:
    """Run one step."""
    return _module(arguments.step).run(arguments)


def _module(step: str):
    return importlib.import_module(f'ftp_dent_ros.cli.calibrate_{step}')
