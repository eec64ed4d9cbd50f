"""What a report tells beside its dents: from what, with what, and what it does not know."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ftp_dent_ros.inspection.measuring.places.kinds import AT_RIM
from ftp_dent_ros.inspection.reporting.content import Frame, Report
from ftp_dent_ros.inspection.reporting.records import iso_time

_MM = 1000.0


def facts_of(report: Report) -> list[tuple[str, str]]:
    """Names and values, in the order in which they are shown."""
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
        ('Marks of gouges', _marks(frames)),
        ('Would have been found', _findable(frames, report.settings.smallest_depth)),
        ('Not measured', _not_measured(report)),
        ('Waviness', _waviness(frames)),
        ('Noise of a point', f'{np.median(noise) * _MM:.3f} mm' if noise else 'not known'),
        ('Rig', _rig(report)),
        ('Positions in', report.frame_id),
        ('Pose', _pose(frames)),
        ('Software', f'ftp_dent_ros {report.version}'),
        ('Report written', iso_time(report.written_ns)),
    ]
    facts += [('Note', each) for each in report.remarks]
    if report.rules:
        facts.append(('Limits', report.rules.title or report.rules.reference or 'given'))
    return facts


def _rig(report: Report) -> str:
    """File and id of the rig, as far as they are known."""
    if not report.rig_id:
        return 'not told'
    return f'{report.rig_name}, id {report.rig_id}' if report.rig_name else f'id {report.rig_id}'


def _smallest(report: Report) -> str:
    depth, width = report.settings.smallest_depth, report.settings.smallest_width
    return f'dents of {depth * _MM:g} mm depth and {width * _MM:g} mm width, and larger'


def _marks(frames: Sequence[Frame]) -> str:
    without = sum(not frame.has_skin for frame in frames)
    if not without:
        return 'looked for in the image of the skin'
    clouds = f'{without} of {len(frames)} clouds have' if len(frames) > 1 else 'the cloud has'
    return f'{clouds} no image of the skin: narrow gouges were not looked for there'


def _findable(frames: Sequence[Frame], smallest_depth: float) -> str:
    known = [f.findable for f in frames if math.isfinite(f.findable[1])]
    if not known:
        return 'not known'
    half, most = (max(each) * _MM for each in zip(*known, strict=True))
    at_rim = max(AT_RIM * smallest_depth * _MM, most)
    return (
        f'dents of the smallest width from {half:.2f} mm depth on half of the measured area of '
        f'every cloud, from {most:.2f} mm on 95 % of it; where its rim cuts them, from '
        f'{at_rim:.2f} mm, and else in doubt'
    )


def _not_measured(report: Report) -> str:
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
