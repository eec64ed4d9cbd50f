"""``ftp-dent surveys``: the surveys of an aircraft that are kept in a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pages.words import date_of
from ftp_dent_ros.survey.store import SurveyStore, survey_from_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('file', metavar='FILE.sqlite', help='of one aircraft; made if need be')
    parser.add_argument(
        '--add',
        metavar='REPORT',
        help='add what `ftp-dent inspect` has written: its folder, or dents.json',
    )
    parser.add_argument('--name', default='', help="of the survey added; default: its folder's")


def run(arguments: argparse.Namespace) -> int:
    """Add one if asked to, and list them."""
    if arguments.name and not arguments.add:
        raise ConfigurationError('--name is of the survey that --add adds: give both, or none')
    store = SurveyStore(Path(arguments.file))
    if arguments.add:
        store.add(survey_from_report(arguments.add, arguments.name))
    names = store.names()
    if not names:
        print(f'{arguments.file}: no survey yet: add one with --add, or `ftp-dent survey --store`')
    for name in names:
        survey = store.read(name)
        dents = sum(each.dent.kind == 'dent' for each in survey.dents)
        coverage = 'no coverage' if survey.coverage is None else 'with coverage'
        print(f'{date_of(survey.taken_ns)}  {name}: {dents} dents, {coverage}')
    return 0
