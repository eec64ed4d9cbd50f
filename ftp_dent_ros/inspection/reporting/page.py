"""The page that people read: one file without any other, on a screen and on paper."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined

from ftp_dent_ros.inspection.dent import Estimate
from ftp_dent_ros.inspection.reporting.content import Frame, Report
from ftp_dent_ros.inspection.reporting.pictures import pictures_of, scale_of
from ftp_dent_ros.inspection.reporting.records import iso_time
from ftp_dent_ros.inspection.reporting.rules import (
    COVERAGE,
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
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    here = resources.files('ftp_dent_ros.inspection.reporting')
    texts = {name: here.joinpath(name).read_text('utf-8') for name in _FILES}
    limit = _limit(report)
    findings = dict(zip((e.number for e in report.dents), report.findings(), strict=True))
    return environment.from_string(texts['page.html']).render(
        report=report,
        style=texts['page.css'],
        script=texts['view.js'],
        scene=json.dumps(scene_of(report, limit)),
        headline=_headline(report, findings),
        facts=_facts(report),
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


def interval(estimate: Estimate, factor: float = _MM, finest: int = 2) -> tuple[str, str]:
    """A value and half its 95 % interval, in as many digits as that has a meaning."""
    value, half = estimate.value * factor, COVERAGE * estimate.uncertainty * factor
    if not math.isfinite(value):
        return '–', ''
    if not math.isfinite(half) or half <= 0:
        return f'{value:.3g}', ''
    places = -math.floor(math.log10(half))
    # At least one digit of the interval, two where they are not finer than can be of use.
    digits = max(min(places + 1, finest), places, 0)
    return f'{value:.{digits}f}', f'± {half:.{digits}f}'


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


def _facts(report: Report) -> list[tuple[str, str]]:
    frames = report.frames
    stamps = sorted(frame.stamp_ns for frame in frames if frame.stamp_ns is not None)
    taken = 'not known'
    if stamps:
        taken = iso_time(stamps[0])
        if stamps[-1] != stamps[0]:
            taken += f' to {iso_time(stamps[-1])}'
    noise = [frame.noise for frame in frames if math.isfinite(frame.noise)]
    area = 1e4 * sum(frame.area for frame in frames)
    facts = [
        ('Inspected', report.source),
        ('Photographed', taken),
        (
            'Clouds',
            f'{len(frames)}'
            + f', {len(report.refused)} refused' * bool(report.refused)
            + f'; {len(report.skipped)} messages skipped' * bool(report.skipped),
        ),
        ('Measured area', f'{area:.0f} cm²' + (', overlaps counted twice' * (len(frames) > 1))),
        ('Looked for', _smallest(report)),
        ('Would have been found', _findable(frames)),
        ('Not measured', _not_measured(report)),
        ('Waviness', _waviness(frames)),
        ('Noise of a point', f'{np.median(noise) * _MM:.3f} mm' if noise else 'not known'),
        ('Rig', f'{report.rig_name}, id {report.rig_id}' if report.rig_id else 'not given'),
        ('Positions in', report.frame_id),
        ('Pose', _pose(frames)),
        ('Software', f'ftp_dent_ros {report.version}'),
        ('Report written', iso_time(report.written_ns)),
    ]
    if report.rules:
        facts.append(('Limits', report.rules.title or report.rules.reference or 'given'))
    return facts


def _smallest(report: Report) -> str:
    depth, width = report.settings.smallest_depth, report.settings.smallest_width
    return f'dents of {depth * _MM:g} mm depth and {width * _MM:g} mm width, and larger'


def _findable(frames: Sequence[Frame]) -> str:
    known = [f.findable for f in frames if math.isfinite(f.findable[1])]
    if not known:
        return 'not known'
    half, most = (max(each) * _MM for each in zip(*known, strict=True))
    return (
        f'dents of the smallest width from {half:.2f} mm depth on half of the measured area of '
        f'every cloud, from {most:.2f} mm on 95 % of it'
    )


def _not_measured(report: Report) -> str:
    """Of the worst cloud, and what was left out whole."""
    shares = [f.coverage for f in report.frames if f.coverage is not None]
    left = f'{len(report.refused)} clouds left out; ' if report.refused else ''
    if not shares:
        return left + 'of the lit skin not known: the cloud does not tell'
    worst = min(shares, key=lambda coverage: coverage.share)
    words = f'{100 * (1 - worst.share):.1f} % of the lit skin' + (
        ' in the worst cloud' if len(shares) > 1 else ''
    )
    return left + '; '.join((words, *worst.remarks))


def _waviness(frames: Sequence[Frame]) -> str:
    waves = [wave for frame in frames for wave in frame.waviness]
    if not waves:
        return 'none beyond the noise'
    largest = max(waves, key=lambda wave: wave.amplitude)
    return (
        f'up to {largest.amplitude * _MM:.3f} mm amplitude, '
        f'{largest.wavelength * _MM:.0f} mm wavelength'
    )


def _pose(frames: Sequence[Frame]) -> str:
    posed = [frame for frame in frames if frame.pose is not None]
    if not posed:
        return 'none: positions are relative to the camera'
    known = [frame.covariance for frame in posed if frame.covariance is not None]
    if not known:
        return f'of {len(posed)} clouds, its uncertainty not known'
    spread = max(math.sqrt(float(np.trace(each[:3, :3])) / 3) for each in known)
    turn = max(math.sqrt(float(np.trace(each[3:, 3:])) / 3) for each in known)
    return (
        f'of {len(posed)} clouds, standard uncertainty at most {spread * _MM:.0f} mm '
        f'and {math.degrees(turn):.2f}° an axis'
    )


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
        'reason': dent.reason,
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
