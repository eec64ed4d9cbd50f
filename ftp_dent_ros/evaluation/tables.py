"""The evaluation's figures as tables, beside those of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ftp_dent_ros.evaluation.study import ESTRADA, ITOH, SMOOTHER, Entry, Study
from ftp_dent_ros.evaluation.trial import LEAST_SQUARES, Method

_COLUMNS = ('', 'method', 'MAE (std), mm', 'paper, mm', 'dent MAE', 'depth bias', 'coverage', 'ms')


@dataclass(frozen=True)
class Table:
    """A table of the page."""

    title: str
    remark: str
    rows: list[tuple[str, ...]]
    columns: tuple[str, ...] = _COLUMNS


def tables_of(study: Study) -> list[Table]:
    """All tables of the page."""
    section = (*ITOH, *ESTRADA, *SMOOTHER, LEAST_SQUARES)
    photographs = 'noise of 12,000 electrons at saturation, 0.8 grey levels of read noise, 8 bits'
    return [
        _table(
            study,
            'Section 3: dent of 3 mm x 30 mm at 1 m',
            'White noise of 0.6 rad, added to the phase map (as in the paper), or put into the '
            'light of each pixel before it is photographed, or none. Where a photograph was '
            'refused, the figures are of the others.',
            'section 3',
            section,
        ),
        _table(
            study,
            "Table 3: samples at 60 cm, Itoh's unwrapping",
            f'Photographs with {photographs}.',
            'static',
            (*ITOH, LEAST_SQUARES),
        ),
        _table(
            study,
            "Table 4: samples at 60 cm, Estrada's unwrapping",
            f'Photographs with {photographs}.',
            'static',
            (*ESTRADA, LEAST_SQUARES),
        ),
        _table(
            study,
            "Table 6: samples at 120 cm, Estrada's unwrapping",
            f'Moving at 0.1 m/s, exposed for 10 ms, and still; photographs with {photographs}.',
            'dynamic',
            (*ESTRADA, LEAST_SQUARES),
        ),
        _times(study),
    ]


def _table(
    study: Study, title: str, remark: str, table: str, methods: tuple[Method, ...]
) -> Table:
    rows = []
    for row, entries in study.of(table).items():
        label = row
        for entry in entries:
            if entry.method not in methods:
                continue
            rows.append((label, *_cells(entry)))
            label = ''
    return Table(title, remark, rows)


def _cells(entry: Entry) -> tuple[str, ...]:
    figures, paper = entry.figures, entry.paper
    said = f'{paper[0]:.3f} ({paper[1]:.3f})' if paper else ''
    if entry.refused == entry.case.seeds:
        return entry.method.name, f'refused {entry.refused} of {entry.refused}', said, *[''] * 4
    refused = f', refused {entry.refused} of {entry.case.seeds}' if entry.refused else ''
    return (
        entry.method.name,
        f'{figures.mae:.4f} ({figures.deviation:.4f}){refused}',
        said,
        _number(figures.dent_mae, '.4f'),
        _number(figures.depth_bias, '+.4f'),
        f'{100 * figures.coverage:.1f} %',
        _number(1e3 * figures.seconds, '.0f'),
    )


def _number(value: float, form: str) -> str:
    return '' if math.isnan(value) else format(value, form)


def _times(study: Study) -> Table:
    """Running times; the paper's are of its Python implementation (section 3)."""
    paper = {ITOH[0].name: '360', ITOH[1].name: '1180'}
    sizes = {'1280x720': ('section 3', 'none'), '1920x1080': ('static', 'A')}
    rows = []
    for method in (*ITOH, *ESTRADA, LEAST_SQUARES):
        times = [
            _number(1e3 * study.one(table, row, method).figures.seconds, '.0f')
            for table, row in sizes.values()
        ]
        rows.append((method.name, *times, paper.get(method.name, '')))
    columns = 'method', *(f'{size}, ms' for size in sizes), 'paper, 1280x720, ms'
    return Table('Running time, one photograph, tables warm', '', rows, columns)
