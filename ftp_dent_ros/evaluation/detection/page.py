"""The probability of detection as a page that opens offline, and as JSON."""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from matplotlib.figure import Figure

from ftp_dent_ros import __version__
from ftp_dent_ros.evaluation.detection.results import WIDTH, Blank, Row, sentence
from ftp_dent_ros.evaluation.detection.trials import DISTANCES, Trial
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.pages.words import finite

_MM = 1e3
_COLOURS = {'clean': '#1b6ca8', 'dirty': '#b5651d', 'wavy': '#2e8b57'}


def write_page(
    folder: Path,
    trials: Sequence[Trial],
    rows: Sequence[Row],
    blanks: Sequence[Blank],
    smallest_depth: float,
) -> Path:
    """Write ``detection.html`` and ``detection.json``; return the page's path."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader('ftp_dent_ros.evaluation', 'templates'),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    quoted = sentence(rows, blanks, smallest_depth)
    text = environment.get_template('detection.html.j2').render(
        sentence=quoted,
        rows=[_cells(row) for row in rows],
        blanks=[_blank_cells(blank) for blank in blanks],
        curves=_curves(trials, rows),
        dents=sum(row.detection.dents for row in rows),
        photographs=len(trials),
        width=f'{_MM * WIDTH:g}',
        smallest=f'{_MM * smallest_depth:g}',
        version=__version__,
    )
    record: dict[str, Any] = {
        'sentence': quoted,
        'width_mm': _MM * WIDTH,
        'smallest_depth_mm': _MM * smallest_depth,
        'rows': [asdict(row) for row in rows],
        'blanks': [{**asdict(blank), 'at_most_per_m2': blank.most} for blank in blanks],
    }
    with written_aside(folder / 'detection.json') as aside:
        aside.write_text(json.dumps(finite(record), indent=1, allow_nan=False) + '\n')
    page = folder / 'detection.html'
    with written_aside(page) as aside:
        aside.write_text(text, encoding='utf-8')
    return page


def _cells(row: Row) -> list[str]:
    d = row.detection
    return [
        f'{row.distance:g} m',
        row.skin,
        f'{d.hits} of {d.dents}',
        _mm(d.a90),
        _mm(d.a90_95),
        '–' if math.isnan(row.bias) else f'{100 * row.bias:+.1f} %',
        '–' if math.isnan(row.scatter) else f'{100 * row.scatter:.1f} %',
    ]


def _blank_cells(blank: Blank) -> list[str]:
    rate = '–' if not blank.area else f'{blank.calls / blank.area:.3f}'
    most = '–' if not blank.area else f'{blank.most:.3f}'
    numbers = [str(blank.photographs), f'{blank.area:.1f}', str(blank.calls), rate, most]
    return [blank.skin, *numbers, str(blank.others)]


def _mm(value: float) -> str:
    return '–' if math.isnan(value) else f'{_MM * value:.3f}'


def _curves(trials: Sequence[Trial], rows: Sequence[Row]) -> str:
    """Probability of detection over the depth, a picture a distance, as a data URI."""
    figure = Figure(figsize=(10, 3.4), layout='constrained')
    axes = figure.subplots(1, len(DISTANCES), sharey=True)
    depths = np.geomspace(2e-5, 1e-3, 200)
    for axis, distance in zip(axes, DISTANCES, strict=True):
        for row in (row for row in rows if row.distance == distance):
            colour = _COLOURS[row.skin]
            if math.isfinite(row.detection.a90):
                chance = row.detection.probability(depths, WIDTH)
                axis.plot(_MM * depths, chance, color=colour, label=row.skin)
            if math.isfinite(row.detection.a90_95):
                axis.plot(_MM * row.detection.a90_95, 0.9, 'o', color=colour, ms=5)
            seen = [
                dent
                for trial in trials
                if (trial.distance, trial.skin) == (distance, row.skin)
                for dent in trial.dents
            ]
            if seen:
                depth, _, hit, _ = np.array(seen, float).T
                axis.plot(_MM * depth, hit, '|', color=colour, alpha=0.5, ms=7)
        axis.axhline(0.9, color='#999', lw=0.7, ls=':')
        axis.set_xscale('log')
        axis.set_title(f'{distance:g} m', fontsize=10)
        axis.set_xlabel('depth, mm')
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize=8, frameon=False, loc='center right')
    axes[0].set_ylabel('probability of detection')
    png = io.BytesIO()
    figure.savefig(png, format='png', dpi=130)
    return 'data:image/png;base64,' + base64.b64encode(png.getvalue()).decode()
