"""The comparison as a page that people read: one file, on a screen and on paper."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from ftp_dent_ros import __version__
from ftp_dent_ros.inspection.dent import Estimate
from ftp_dent_ros.inspection.reporting.figures import interval
from ftp_dent_ros.inspection.reporting.rules import Rules, clearance, verdict, width_to_depth
from ftp_dent_ros.survey.aircraft_frame import AircraftFrame
from ftp_dent_ros.survey.comparing.chart import Row, date_of, growth_of
from ftp_dent_ros.survey.comparing.comparison import STATUSES, Comparison, Status
from ftp_dent_ros.survey.result import SurveyResult

_MM = 1e3
# Of the map, the drawing's units.
_WIDTH, _LEAST_HEIGHT, _MOST_HEIGHT = 1000.0, 120.0, 700.0
_MARGIN = 40.0
_SCALE_BARS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)


def comparison_page(
    comparison: Comparison,
    rows: list[Row],
    frame: AircraftFrame | None = None,
    rules: Rules | None = None,
) -> str:
    """The whole page as HTML."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    here = resources.files('ftp_dent_ros.survey')
    style = resources.files('ftp_dent_ros.inspection.reporting').joinpath('page.css')
    counts: Counter[Status] = Counter(row.compared.status for row in rows)
    groups = [
        {'status': status, 'meaning': meaning, 'rows': found}
        for status, meaning in STATUSES.items()
        if (found := [_cells(row) for row in rows if row.compared.status == status])
    ]
    return environment.from_string(here.joinpath('comparison.html').read_text('utf-8')).render(
        style=style.read_text('utf-8'),
        earlier=comparison.earlier,
        later=comparison.later,
        headline=_headline(counts),
        facts=_facts(comparison, frame),
        groups=groups,
        map=_map(rows),
        location='Station, buttock line, water line' if frame else 'Location x, y, z',
        rules=rules,
        classes={'within': 'within', 'exceeds': 'exceeds', 'cannot decide': 'undecided'},
    )


def _headline(counts: Mapping[Status, int]) -> str:
    texts: dict[Status, str] = {
        'first seen': 'seen for the first time',
        'not seen': 'not seen again',
        'known': 'as before',
    }
    words = [f'{counts[each]} {texts.get(each, each)}' for each in STATUSES if counts[each]]
    return ', '.join(words) or 'No dents'


def _facts(comparison: Comparison, frame: AircraftFrame | None) -> list[tuple[str, str]]:
    matching = comparison.matching
    walk = math.sqrt(matching.forward.walk) * _MM
    scales = ', '.join(
        f'{each.quantity} {100 * (each.factor - 1):+.2f} ± {196 * each.uncertainty:.2f} %'
        for each in comparison.scales
    )
    noise = ', '.join(f'{each.quantity} {each.noise:.2f}' for each in comparison.scales)
    facts = [
        ('Earlier survey', _survey(comparison.earlier)),
        ('Later survey', _survey(comparison.later)),
        ('In both', f'{len(matching.pairs)} dents, by which the surveys lie on each other'),
        ('Maps apart', f'{walk:.2g} mm over a metre, root mean square along an axis'),
        ('Later sees larger', f'{scales}; taken out of every growth'),
        ('Differences scatter', f'by so many times what is stated: {noise}'),
    ]
    if frame is not None:
        worst = float(np.linalg.norm(frame.residuals, axis=1).max()) * _MM
        facts.append(
            ('Aircraft frame', f'by {len(frame.points)} points, within {worst:.1f} mm of it')
        )
    return [*facts, ('Software', f'ftp_dent_ros {__version__}')]


def _survey(survey: SurveyResult) -> str:
    coverage = '' if survey.coverage is not None else ', coverage not kept'
    return (
        f'{survey.name}, {date_of(survey.taken_ns)}, '
        f'{sum(each.dent.kind == "dent" for each in survey.dents)} dents{coverage}'
    )


def _cells(row: Row) -> dict[str, Any]:
    dent, growth = row.dent, growth_of(row)
    return {
        'number': row.number,
        'before': '' if row.compared.earlier is None else str(row.compared.earlier.number),
        'kind': dent.kind,
        'depth': interval(dent.depth, finest=3),
        'length': interval(dent.length),
        'width': interval(dent.width),
        'ratio': interval(width_to_depth(dent), 1.0),
        'clearance': interval(clearance(dent), finest=1),
        'growth': ('–', '') if growth is None else _signed(*growth),
        'location': [f'{value:.3f}' for value in row.location],
        'spread': f'{row.uncertainty * _MM:.1f}',
        'first_seen': row.first_seen,
        'verdict': verdict(row.findings),
        'cut': dent.is_cut,
        'others': '; '.join(
            f'{each.quantity} {each.estimate.value * _MM:+.2f} ± {each.half * _MM:.2f} mm'
            for each in row.compared.changes
            if each.quantity != 'depth' and each.verdict
        ),
        'reason': row.compared.reason,
    }


def _signed(estimate: Estimate, half: float) -> tuple[str, str]:
    if not (math.isfinite(estimate.value) and math.isfinite(half)):
        return '–', ''
    return f'{estimate.value * _MM:+.3f}', f'± {half * _MM:.3f}'


def _map(rows: list[Row]) -> dict[str, Any] | None:
    """Where the dents lie, on the plane that they spread along."""
    if len(rows) < 2:
        return None
    places = np.stack([row.location for row in rows])
    middle = places.mean(axis=0)
    _, _, axes = np.linalg.svd(places - middle, full_matrices=False)
    flat = (places - middle) @ axes[:2].T
    # Not mirrored: as seen from outside.
    normal = np.mean([row.dent.normal for row in rows], axis=0)
    if np.cross(axes[0], axes[1]) @ normal > 0:
        flat[:, 1] *= -1
    low, size = flat.min(axis=0), np.maximum(np.ptp(flat, axis=0), 1e-3)
    scale = min((_WIDTH - 2 * _MARGIN) / size[0], (_MOST_HEIGHT - 2 * _MARGIN) / size[1])
    at = (flat - low) * scale + _MARGIN
    bar = min(_SCALE_BARS, key=lambda each: abs(math.log(each * scale / (_WIDTH / 7))))
    return {
        'width': _WIDTH,
        'height': max(size[1] * scale + 2 * _MARGIN, _LEAST_HEIGHT),
        'dents': [
            {
                'x': f'{x:.1f}',
                'y': f'{y:.1f}',
                'number': row.number,
                'status': row.compared.status.replace(' ', '-'),
            }
            # What stands out is drawn last.
            for row, (x, y) in reversed(list(zip(rows, at, strict=True)))
        ],
        'bar': {'length': bar * scale, 'text': f'{bar * _MM:g} mm'},
    }
