"""``ftp-dent surveys``: the surveys of an aircraft that are kept in a file."""

from __future__ import annotations

import argparse

from ftp_dent_ros.cli import argument
from ftp_dent_ros.files import find
from ftp_dent_ros.pages.words import date_of
from ftp_dent_ros.survey.store import SurveyStore

ARGUMENTS = (argument('file', metavar='FILE.sqlite', help='of `ftp-dent survey --store`'),)


def run(arguments: argparse.Namespace) -> int:
    """List them."""
    store = SurveyStore(find(arguments.file))
    for survey in map(store.read, store.names()):
        print(f'{date_of(survey.taken_ns)}  {survey.name}: {survey.count} dents')
    return 0
