"""The page that people read: one file without any other, on a screen and on paper."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined

from ftp_dent_ros.inspection.dent import Estimate
from ftp_dent_ros.inspection.reporting.content import Frame, Report
from ftp_dent_ros.inspection.reporting.facts import facts_of
from ftp_dent_ros.inspection.reporting.figures import interval
from ftp_dent_ros.inspection.reporting.pictures import pictures_of, scale_of
from ftp_dent_ros.inspection.reporting.records import iso_time
from ftp_dent_ros.inspection.reporting.rules import (
    EXCEEDS,
    UNDECIDED,
    WITHIN,
    Finding,
    clearance,
    verdict,
    width_to_depth,
)
from ftp_dent_ros.inspection.reporting.scene import scene_of
from ftp_dent_ros.inspection.reporting.sections import sections_of
from ftp_dent_ros.inspection.tracking.sightings import ListedDent

_MM = 1000.0
# The scale of the colours reaches at least so many standard deviations of a point.
_SIGMAS = 5.0


def page(report: Report) -> str:
    """The whole page as HTML."""
    here = resources.files('ftp_dent_ros.inspection.reporting')
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(lambda name: here.joinpath(name).read_text('utf-8')),
    )
    texts = {name: here.joinpath(name).read_text('utf-8') for name in _FILES}
    limit = _limit(report)
    findings = dict(zip((e.number for e in report.dents), report.findings(), strict=True))
    return environment.from_string(texts['page.html']).render(
        report=report,
        style=texts['page.css'],
        script=texts['view.js'],
        scene=json.dumps(scene_of(report, limit)),
        headline=_headline(report, findings),
        facts=facts_of(report),
        dents=[_dent(entry, findings[entry.number], limit) for entry in report.dents],
        others=[_dent(entry, (), limit) for entry in report.others],
        frames=[pictures_of(frame, report, limit) for frame in report.frames if frame.view],
        seen=[_seen(frame, report) for frame in report.frames],
        repeatability=[_repeatability(each) for each in report.repeatability],
        several=len(report.frames) > 1,
        rules=report.rules,
        classes={WITHIN: 'within', EXCEEDS: 'exceeds', UNDECIDED: 'undecided'},
        scale=scale_of(limit),
    )


_FILES = ('page.html', 'page.css', 'view.js')


def _limit(report: Report) -> float:
    """End of the colour scale, metres: a round number beyond the deepest dent and the noise."""
    depths = [abs(entry.dent.depth.value) for entry in report.entries]
    depths += [_SIGMAS * frame.noise for frame in report.frames]
    largest = max((depth for depth in depths if math.isfinite(depth)), default=0.0)
    largest = max(largest, 1e-4)
    power = 10.0 ** math.floor(math.log10(largest))
    return next(
        step * power for step in (1, 1.5, 2, 3, 5, 7, 10) if 1.05 * step * power >= largest
    )


def _headline(report: Report, findings: dict[int, tuple[Finding, ...]]) -> dict[str, Any]:
    dents = report.dents
    count = len(dents)
    found = f'{count or "No"} dent{"" if count == 1 else "s"} found'
    deepest = ''
    if dents:
        value, half = interval(dents[0].dent.depth, finest=3)
        deepest = f'The deepest, no. {dents[0].number}, is {value} {half} mm deep.'
    kinds = Counter(entry.dent.kind for entry in report.others)
    besides = ' and '.join(
        f'{number} {kind}{"" if number == 1 else "s"}' for kind, number in sorted(kinds.items())
    )
    cut = sum(entry.dent.is_cut for entry in dents)
    verdicts = Counter(verdict(found) for found in findings.values() if found)
    return {
        'found': found,
        'deepest': deepest,
        'besides': f'Also found: {besides}.' if besides else '',
        'cut': cut,
        'verdicts': [(word, verdicts[word]) for word in (EXCEEDS, UNDECIDED, WITHIN)],
    }


def _dent(entry: ListedDent, findings: Sequence[Finding], limit: float) -> dict[str, Any]:
    dent = entry.dent
    square, cube = _MM**2, _MM**3
    return {
        'number': entry.number,
        'kind': dent.kind,
        'depth': interval(dent.depth, finest=3),
        'length': interval(dent.length),
        'width': interval(dent.width),
        'ratio': interval(width_to_depth(dent), 1.0),
        'orientation': interval(dent.orientation, 180 / math.pi, 1),
        'area': interval(dent.area, square, 0),
        'volume': interval(dent.volume, cube, 0),
        'model': (interval(dent.model_length), interval(dent.model_width)),
        'clearance': interval(clearance(dent), finest=1),
        'position': [f'{value:.3f}' for value in dent.position],
        'spread': f'{math.sqrt(float(np.trace(entry.position_covariance)) / 3) * _MM:.0f}',
        'sightings': len(entry.sightings),
        'frame': entry.best,
        'cut': dent.is_cut,
        'reason': entry.reason,
        'verdict': verdict(findings),
        'findings': [_finding(finding) for finding in findings],
        'sections': sections_of(dent, limit),
    }


def _finding(finding: Finding) -> dict[str, str]:
    value, half = interval(Estimate(finding.value, finding.uncertainty), 1.0, 3)
    return {
        'measure': finding.limit.measure.replace('_', ' ').replace(' mm', ', mm'),
        'limit': finding.limit.text,
        'value': f'{value} {half}',
        'verdict': finding.verdict,
        'reference': finding.limit.reference,
    }


def _repeatability(each: Any) -> list[str]:
    spreads = (each.within, each.between, each.total)
    figures = ['–' if math.isnan(value) else f'{value * _MM:.3f}' for value in spreads]
    return [each.quantity, str(each.dents), str(each.frames), *figures]


def _seen(frame: Frame, report: Report) -> list[str]:
    pose = frame.pose
    place = '–' if pose is None else ', '.join(f'{value:.3f}' for value in pose.translation)
    spread = '–'
    if frame.covariance is not None:
        spread = f'{math.sqrt(float(np.trace(frame.covariance[:3, :3])) / 3) * _MM:.0f} mm'
    time = frame.name if frame.stamp_ns is None else iso_time(frame.stamp_ns)
    noise = f'{frame.noise * _MM:.3f}' if math.isfinite(frame.noise) else '–'
    return [str(frame.number), time, place, spread, noise, str(frame.dents), str(frame.others)]
