"""The page that people read: one file without any other, on a screen and on paper."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ftp_dent_ros import __version__
from ftp_dent_ros.dents.dent import COVERAGE, Estimate, MeasuredDent
from ftp_dent_ros.dents.rules import EXCEEDS, UNDECIDED, WITHIN, Judgement, verdict
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.files import write_texts
from ftp_dent_ros.inspection.measuring.kinds import AT_RIM
from ftp_dent_ros.inspection.records import csv_text, report_record
from ftp_dent_ros.inspection.report import (
    DrawnCloud,
    InspectionReport,
    ReportedCloud,
    away_from_camera,
)
from ftp_dent_ros.pages import drawing
from ftp_dent_ros.pages.page import render
from ftp_dent_ros.pages.words import deviation_of, interval, iso_time, position_interval
from ftp_dent_ros.rig.rig import Lens

# Of one profile's axes, in the drawing's units; the template puts the text around it.
WIDTH, HEIGHT = 300, 110


def write_report(folder: str | os.PathLike[str], report: InspectionReport) -> Path:
    """Write dents.json, dents.csv and report.html into a folder; the path of the page.

    Raises
    ------
    ConfigurationError
        They cannot be written: none of them is.
    """
    record = report_record(report)
    texts = {
        'dents.json': json.dumps(record, indent=1, allow_nan=False) + '\n',
        'dents.csv': csv_text(record),
        'report.html': page(report),
    }
    write_texts(folder, texts, 'the report')
    return Path(folder) / 'report.html'


def page(report: InspectionReport) -> str:
    """The whole page as HTML."""
    limit = _limit(report)
    findings = dict(zip((e.number for e in report.dents), report.findings(), strict=True))
    return render(
        'ftp_dent_ros.inspection',
        'page.html',
        report=report,
        scene=json.dumps(scene_of(report, limit)),
        headline=_headline(report, findings),
        facts=facts_of(report),
        dents=[_dent(entry, findings[entry.number], limit) for entry in report.dents],
        others=[_dent(entry, (), limit) for entry in report.others],
        frames=[pictures_of(frame, report, limit) for frame in report.frames if frame.view],
        seen=[_seen(frame) for frame in report.frames],
        several=len(report.frames) > 1,
        rules=report.rules,
        scale=drawing.depth_scale(limit),
    )


def _limit(report: InspectionReport) -> float:
    """End of the colour scale, metres: a round number beyond the deepest dent and the noise."""
    depths = [abs(entry.dent.depth.value) for entry in report.entries]
    # Five standard deviations of a point: noise alone has no strong colours.
    depths += [5 * frame.noise for frame in report.frames]
    largest = max((depth for depth in depths if math.isfinite(depth)), default=0.0)
    largest = max(largest, 1e-4)
    return _round_up(largest / 1.05, (1, 1.5, 2, 3, 5, 7, 10))


def _headline(
    report: InspectionReport, findings: dict[int, tuple[Judgement, ...]]
) -> dict[str, Any]:
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


def _dent(entry: ListedDent, findings: Sequence[Judgement], limit: float) -> dict[str, Any]:
    dent = entry.dent
    return {
        'number': entry.number,
        'kind': dent.kind,
        'depth': interval(dent.depth, finest=3),
        'length': interval(dent.length),
        'width': interval(dent.width),
        'ratio': interval(dent.width_to_depth, 1.0),
        'orientation': interval(dent.orientation, 180 / math.pi, 1),
        'area': interval(dent.area, 1e6, 0),
        'volume': interval(dent.volume, 1e9, 0),
        'model': (interval(dent.model_length), interval(dent.model_width)),
        'clearance': interval(dent.clearance_estimate, finest=1),
        'position': [f'{value:.3f}' for value in dent.position],
        'spread': position_interval(entry.position_covariance),
        'sightings': len(entry.sightings),
        'frame': entry.best,
        'cut': dent.is_cut,
        'reason': entry.reason,
        'verdict': verdict(findings),
        'findings': [_finding(finding) for finding in findings],
        'sections': sections_of(dent, limit),
    }


def _finding(finding: Judgement) -> dict[str, str]:
    value, half = interval(Estimate(finding.value, finding.uncertainty), 1.0, 3)
    return {
        'measure': finding.limit.measure.replace('_', ' ').replace(' mm', ', mm'),
        'limit': finding.limit.text,
        'value': f'{value} {half}',
        'verdict': finding.verdict,
        'reference': finding.limit.reference,
    }


def _seen(frame: ReportedCloud) -> list[str]:
    pose = frame.pose
    place = '–' if pose is None else ', '.join(f'{value:.3f}' for value in pose.translation)
    spread = '–'
    if frame.covariance is not None:
        spread = position_interval(frame.covariance[:3, :3])
    time = frame.name if frame.stamp_ns is None else iso_time(frame.stamp_ns)
    noise = f'{frame.noise * 1e3:.4f}' if math.isfinite(frame.noise) else '–'
    return [str(frame.number), time, place, spread, noise, str(frame.dents), str(frame.others)]


def facts_of(report: InspectionReport) -> list[tuple[str, str]]:
    """Names and values, in the order in which they are shown."""
    frames = report.frames
    stamps = sorted(frame.stamp_ns for frame in frames if frame.stamp_ns is not None)
    taken = 'not known'
    if stamps:
        taken = iso_time(stamps[0])
        if stamps[-1] != stamps[0]:
            taken += f' to {iso_time(stamps[-1])}'
    noise = [frame.noise for frame in frames if math.isfinite(frame.noise)]
    depth, width = report.settings.smallest_depth * 1e3, report.settings.smallest_width * 1e3
    area = 1e4 * sum(frame.area for frame in frames)
    rig = ', '.join(filter(None, (report.rig_name, report.rig_id and f'id {report.rig_id}')))
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
        ('Looked for', f'dents of {depth:g} mm depth and {width:g} mm width, and larger'),
        ('Would have been found', _findable(frames, report.settings.smallest_depth)),
        ('Not measured', _not_measured(report)),
        ('Waviness', _waviness(frames)),
        ('Noise of a point', f'{np.median(noise) * 1e3:.4f} mm' if noise else 'not known'),
        ('Rig', rig or 'not known'),
        ('Positions in', report.frame_id),
        ('Pose', _pose(frames)),
        ('Software', f'ftp_dent_ros {__version__}'),
        ('Report written', iso_time(report.written_ns)),
    ]
    facts += [('Note', each) for each in report.remarks]
    if report.rules:
        facts.append(('Limits', report.rules.title or report.rules.reference or 'given'))
    return facts


def _findable(frames: Sequence[ReportedCloud], smallest_depth: float) -> str:
    known = [f.findable for f in frames if math.isfinite(f.findable[1])]
    if not known:
        return 'not known'
    half, most = (max(each) * 1e3 for each in zip(*known, strict=True))
    at_rim = max(AT_RIM * smallest_depth * 1e3, most)
    return (
        f'dents of the smallest width from {half:.2f} mm depth on half of the measured area of '
        f'every cloud, from {most:.2f} mm on 95 % of it; where its rim cuts them, from '
        f'{at_rim:.2f} mm, and else in doubt'
    )


def _not_measured(report: InspectionReport) -> str:
    """Of the worst cloud, and what was left out whole."""
    shares = [f.coverage for f in report.frames if f.coverage is not None]
    left = f'{len(report.refused)} clouds left out; ' if report.refused else ''
    if not shares:
        return left + 'of the lit skin not known: the cloud does not tell'
    worst = min(shares, key=lambda coverage: coverage.share)
    words = f'{100 * (1 - worst.share):.1f} % of the lit skin' + (
        ' in the worst cloud' if len(report.frames) > 1 else ''
    )
    return left + '; '.join((words, *worst.remarks))


def _waviness(frames: Sequence[ReportedCloud]) -> str:
    waves = [wave for frame in frames for wave in frame.waviness]
    if not waves:
        return 'none beyond the noise'
    largest = max(waves, key=lambda wave: wave.amplitude)
    return (
        f'up to {largest.amplitude * 1e3:.3f} mm amplitude, '
        f'{largest.wavelength * 1e3:.0f} mm wavelength'
    )


def _pose(frames: Sequence[ReportedCloud]) -> str:
    posed = [frame for frame in frames if frame.pose is not None]
    if not posed:
        return 'none: positions are relative to the camera'
    known = [frame.covariance for frame in posed if frame.covariance is not None]
    if not known:
        return f'of {len(posed)} clouds, its uncertainty not known'
    spread = max(deviation_of(each[:3, :3]) for each in known)
    turn = max(deviation_of(each[3:, 3:]) for each in known)
    return (
        f'of {len(posed)} clouds, within ± {COVERAGE * spread * 1e3:.0f} mm '
        f'and ± {COVERAGE * math.degrees(turn):.2f}° an axis (95 %)'
    )


def pictures_of(frame: ReportedCloud, report: InspectionReport, limit: float) -> dict[str, Any]:
    """Heat map and photograph of a frame, with the outlines of the dents that it shows."""
    view = frame.view
    assert view is not None
    shown = [
        entry
        for entry in (*report.dents, *report.others)
        if any(sighting.frame == frame.number for sighting in entry.sightings)
    ]
    rows, columns = view.deviation.shape
    lines = [entry.dent.closed_outline for entry in shown]
    ends = np.cumsum([len(line) for line in lines])[:-1]
    places = np.split(on_grid(np.concatenate(lines), view), ends) if lines else []
    heat = [_outline(entry, place) for entry, place in zip(shown, places, strict=True)]
    photograph = None
    if view.photograph is not None:
        photograph = {
            'data': drawing.data_uri(view.photograph, 'image/jpeg'),
            'width': view.size[0],
            'height': view.size[1],
            'outlines': [
                _outline(entry, on_photograph(line, place, view, report.camera))
                for entry, line, place in zip(shown, lines, places, strict=True)
            ],
        }
    return {
        'number': frame.number,
        'title': frame.name if frame.stamp_ns is None else iso_time(frame.stamp_ns),
        'shows': ', '.join(str(entry.number) for entry in shown),
        'heat': {
            'data': drawing.png(drawing.deviation_colours(view.deviation, limit)),
            'width': columns,
            'height': rows,
            'outlines': heat,
            'bar': _scale_bar(view.points),
        },
        'photograph': photograph,
    }


def _outline(entry: ListedDent, pixels: NDArray[np.float64]) -> dict[str, Any]:
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if not len(pixels):
        pixels = np.zeros((1, 2))
    # The centre of a pixel is at a half in SVG.
    points = ' '.join(f'{u + 0.5:.1f},{v + 0.5:.1f}' for u, v in pixels)
    right, top = pixels[:, 0].max(), pixels[:, 1].min()
    return {
        'points': points,
        'number': entry.number,
        'kind': entry.dent.kind,
        'x': f'{right:.1f}',
        'y': f'{top:.1f}',
    }


def _scale_bar(points: NDArray[np.float32]) -> dict[str, Any] | None:
    """A scale bar in columns of a cloud."""
    step = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    if not np.isfinite(step).any():
        return None
    return drawing.scale_bar(float(np.nanmedian(step)), points.shape[1])


def scene_of(report: InspectionReport, limit: float) -> dict[str, Any]:
    """What the 3-D view shows, about the middle of it all."""
    frames = report.frames
    if not report.placed:
        # Each is where its camera was: one is shown.
        frames = tuple(frame for frame in frames if frame.view)[:1]
    shown = {frame.number for frame in frames}
    grids = [frame.mesh for frame in frames if np.isfinite(frame.mesh).any()]
    if not grids:
        return {'meshes': []}
    every = np.concatenate([grid[np.isfinite(grid[..., 0]), :3] for grid in grids]).astype(float)
    origin = (every.min(axis=0) + every.max(axis=0)) / 2
    inward = [away_from_camera(grid[..., :3]) for grid in grids]
    return {
        'meshes': [
            {
                'rows': len(grid),
                'columns': grid.shape[1],
                'vertices': drawing.coded(grid - np.append(origin, 0)),
                'inward': _mean([away]),
            }
            for grid, away in zip(grids, inward, strict=True)
        ],
        'radius': float(np.linalg.norm(every - origin, axis=1).max()),
        'inward': _mean(inward),
        'down': _mean([np.diff(grid[..., :3], axis=0) for grid in grids]),
        'limit': limit,
        'colours': drawing.colours().ravel().tolist(),
        'dents': [
            {
                'number': entry.number,
                'kind': entry.dent.kind,
                'position': (entry.dent.position - origin).tolist(),
                'outline': np.round(entry.dent.closed_outline - origin, 5).ravel().tolist(),
                'normal': entry.dent.normal.tolist(),
            }
            for entry in (*report.dents, *report.others)
            if shown & {sighting.frame for sighting in entry.sightings}
        ],
    }


def _mean(fields: Sequence[NDArray]) -> list[float]:
    """Direction of the mean of vectors; the view's own where there are none."""
    total = np.sum([np.nansum(field, axis=(0, 1)) for field in fields], axis=0)
    length = float(np.linalg.norm(total))
    return (total / length).tolist() if length else [0.0, 0.0, 1.0]


@dataclass(frozen=True)
class _Axis:
    """From millimetres to the drawing's units."""

    low: float
    high: float
    size: float

    def at(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return (values - self.low) / (self.high - self.low) * self.size

    def marks(self, about: int) -> list[dict[str, Any]]:
        """Round values on the axis."""
        step = _round_up(0.999 * (self.high - self.low) / about, (1, 2, 5, 10))
        values = step * np.arange(math.ceil(self.low / step), math.floor(self.high / step) + 1)
        places = max(0, -math.floor(math.log10(step)))
        return [
            {'at': f'{float(self.at(value)):.1f}', 'text': f'{value:.{places}f}'}
            for value in values + 0.0
        ]


def sections_of(dent: MeasuredDent, limit: float) -> dict[str, Any]:
    """Both profiles on one scale of depth; `limit` is its end, metres."""
    depths = np.concatenate([dent.length_profile, dent.width_profile])[:, 1]
    lowest = float(np.nanmin(depths, initial=-0.15 * limit))
    down = _Axis(lowest * 1e3, limit * 1e3, HEIGHT)
    return {
        'width': WIDTH,
        'height': HEIGHT,
        'down': down.marks(4),
        'skin': f'{float(down.at(np.array(0.0))):.1f}',
        'profiles': [
            _section(name, profile, size, dent.depth.value, down)
            for name, profile, size in (
                ('length', dent.length_profile, dent.length.value),
                ('width', dent.width_profile, dent.width.value),
            )
        ],
    }


def _section(
    name: str, profile: NDArray[np.float64], size: float, depth: float, down: _Axis
) -> dict[str, Any]:
    known = profile[np.isfinite(profile).all(axis=1)] if len(profile) else profile
    if len(known) < 2:
        return {'name': name, 'parts': [], 'along': [], 'span': None}
    at, below = known.T * 1e3
    along = _Axis(float(at.min()), float(at.max()), WIDTH)
    span = None
    level = 0.1 * depth * 1e3
    inside = at[np.sign(depth) * below >= abs(level)]
    if len(inside) and math.isfinite(size):
        # Between the ends of the part that lies within the 10 % contour.
        left, right = along.at(np.array([inside.min(), inside.max()]))
        span = {
            'left': f'{left:.1f}',
            'right': f'{right:.1f}',
            'middle': f'{(left + right) / 2:.1f}',
            'level': f'{float(down.at(np.array(level))):.1f}',
            'text': f'{size * 1e3:.1f}',
        }
    parts = _parts(profile * 1e3, along, down)
    return {'name': name, 'parts': parts, 'along': along.marks(6), 'span': span}


def _parts(profile: NDArray[np.float64], along: _Axis, down: _Axis) -> list[dict[str, str]]:
    """What of a profile is measured, a line each, and from where to where."""
    known = np.isfinite(profile).all(axis=1)
    parts = []
    for part in np.split(profile, np.flatnonzero(np.diff(known)) + 1):
        if not np.isfinite(part).all():
            continue
        at, below = along.at(part[:, 0]), down.at(part[:, 1])
        line = ' '.join(f'{x:.1f},{y:.1f}' for x, y in zip(at, below, strict=True))
        parts.append({'line': line, 'first': f'{at[0]:.1f}', 'last': f'{at[-1]:.1f}'})
    return parts


def _round_up(value: float, rounds: Sequence[float]) -> float:
    """The next of some round numbers times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(each * power for each in rounds if each * power >= value)


def on_grid(points: NDArray[np.float64], view: DrawnCloud) -> NDArray[np.float64]:
    """Column and row of points of the report's frame on a cloud's grid, shape (n, 2).

    Between the four points of the cloud that are nearest; NaN where it has fewer.
    """
    rows, columns = np.nonzero(np.isfinite(view.points).all(axis=-1))
    if len(rows) < 4:
        return np.full((len(points), 2), np.nan)
    # Made in a third of the time of a balanced one, for a few questions.
    tree = cKDTree(view.points[rows, columns], balanced_tree=False, compact_nodes=False)
    distance, nearest = tree.query(view.pose.inverse().apply(points), k=4)
    weight = 1 / np.maximum(distance, 1e-9) ** 2
    places = np.stack([columns, rows], axis=-1)[nearest]
    return (weight[..., None] * places).sum(axis=1) / weight.sum(axis=1, keepdims=True)


def on_photograph(
    points: NDArray[np.float64], place: NDArray[np.float64], view: DrawnCloud, camera: Lens | None
) -> NDArray[np.float64]:
    """Pixels of points of the report's frame in a cloud's photograph, shape (n, 2).

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    place : ndarray, shape (n, 2)
        Theirs `on_grid`.
    view : DrawnCloud
    camera : Lens or None
        If the cloud is in its frame; else the cloud's own grid says where a point is.
    """
    if camera is not None:
        return camera.project(view.pose.inverse().apply(np.asarray(points, float)))
    rows, columns = view.deviation.shape
    width, height = view.size
    # Every n-th pixel from the first has a point.
    stride = max(round(width / columns), round(height / rows), 1)
    return place * stride
