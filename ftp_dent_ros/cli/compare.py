"""``ftp-dent compare``: what has become of the dents between two surveys of one aircraft."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import RULES, output_argument
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find, write_texts
from ftp_dent_ros.survey.aircraft_frame import aircraft_frame, read_reference_points
from ftp_dent_ros.survey.comparison import (
    ComparedDent,
    chart_csv,
    compare,
    comparison_page,
    headline,
)
from ftp_dent_ros.survey.result import SurveyResult
from ftp_dent_ros.survey.store import SurveyStore

PAGE, TABLE = 'comparison.html', 'chart.csv'


ARGUMENTS = (
    argument(
        'earlier',
        metavar='FILE.sqlite:NAME',
        help='file of `ftp-dent survey --store`, and name of a survey in it',
    ),
    argument('later', metavar='FILE.sqlite:NAME', help='that of the later survey'),
    output_argument(f'{PAGE} and {TABLE}'),
    argument(
        '--points',
        type=find,
        metavar='POINTS.yaml',
        help='three or more points of the later survey whose coordinates on the aircraft are '
        'known: all locations are given in these',
    ),
    RULES,
)


def run(arguments: argparse.Namespace) -> int:
    """Compare, print what has changed, and write page and chart."""
    earlier, later = _survey(arguments.earlier), _survey(arguments.later)
    if earlier.taken_ns > later.taken_ns:
        raise ConfigurationError(
            f'{arguments.earlier} was taken after {arguments.later}: give the earlier survey first'
        )
    frame = None
    if arguments.points:
        frame = aircraft_frame(read_reference_points(arguments.points, later))
    comparison = compare(earlier, later, frame, arguments.rules)
    texts = {PAGE: comparison_page(comparison), TABLE: chart_csv(comparison)}
    write_texts(arguments.output, texts, 'the comparison')
    print(summary(comparison.dents))
    print(arguments.output / PAGE)
    return 0


def summary(dents: Sequence[ComparedDent]) -> str:
    """How many of each status, and a line for each that is not as before."""
    lines = [headline(dents)]
    for row in dents:
        if row.status == 'known':
            continue
        line = f'{row.number:>6}  {row.status}, depth {row.shown.dent.depth.value * 1e3:.3f} mm'
        growth = row.changes.get('depth')
        if growth is not None:
            line += f', growth {growth.estimate.value * 1e3:+.3f} ± {growth.half * 1e3:.3f} mm'
        lines.append(line + (f': {row.reason}' if row.reason else ''))
    return '\n'.join(lines)


def _survey(name: str) -> SurveyResult:
    path, _, survey = name.rpartition(':')
    if not path:
        raise ConfigurationError(f'{name}: names no survey of a file: give FILE.sqlite:NAME')
    return SurveyStore(find(path)).read(survey)
