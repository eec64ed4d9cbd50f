"""The report as data: what goes into dents.json and dents.csv."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ftp_dent_ros import __version__
from ftp_dent_ros.dents.dent import FIGURES, uncertain
from ftp_dent_ros.dents.rules import Judgement, Rules, verdict
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.inspection.report import InspectionReport, ReportedCloud
from ftp_dent_ros.pages.words import deviation_of, finite, iso_time, table

_COLUMNS = (
    *('number', 'kind', 'x', 'y', 'z', 'position_uncertainty_mm'),
    *('normal_x', 'normal_y', 'normal_z'),
    *(column for name in FIGURES for column in (name, uncertain(name))),
    *('bottom_radius_mm', 'is_cut', 'reason', 'significance', 'sightings', 'frame', 'verdict'),
)


def report_record(report: InspectionReport) -> dict[str, Any]:
    """The whole report; of numbers that are not finite, None."""
    rules = report.rules
    record = {
        'dents': [
            dent_record(entry, found)
            for entry, found in zip(report.dents, report.findings(), strict=True)
        ],
        'others': [dent_record(entry) for entry in report.others],
        'frame_id': report.frame_id,
        'source': report.source,
        'rig': {'file': report.rig_name or None, 'id': report.rig_id} if report.rig_id else None,
        'rules': {'title': rules.title, 'reference': rules.reference} if rules else None,
        'smallest_depth_mm': report.settings.smallest_depth * 1e3,
        'smallest_width_mm': report.settings.smallest_width * 1e3,
        'frames': [_frame_record(frame) for frame in report.frames],
        'refused': list(report.refused),
        'skipped': list(report.skipped),
        'remarks': list(report.remarks),
        'software': f'ftp_dent_ros {__version__}',
        'written': iso_time(report.written_ns),
    }
    return finite(record)


def list_record(entries: Sequence[ListedDent], rules: Rules | None = None) -> dict[str, Any]:
    """Dents of a list, judged among each other if there are rules, and what else it holds."""
    dents = [entry for entry in entries if entry.dent.kind == 'dent']
    findings = rules.judge([entry.dent for entry in dents]) if rules else [()] * len(dents)
    return {
        'dents': [dent_record(e, found) for e, found in zip(dents, findings, strict=True)],
        'others': [dent_record(entry) for entry in entries if entry.dent.kind != 'dent'],
    }


def dent_record(entry: ListedDent, findings: Sequence[Judgement] = ()) -> dict[str, Any]:
    """One dent: metres for its position, millimetres and degrees for what people read."""
    dent = entry.dent
    return {
        'number': entry.number,
        'kind': dent.kind,
        **{axis: float(value) for axis, value in zip('xyz', dent.position, strict=True)},
        'position_uncertainty_mm': deviation_of(entry.position_covariance) * 1e3,
        **{f'normal_{axis}': float(v) for axis, v in zip('xyz', dent.normal, strict=True)},
        **dent.figures(FIGURES),
        'bottom_radius_mm': float(dent.bottom_radius) * 1e3,
        'is_cut': bool(dent.is_cut),
        'reason': entry.reason,
        'significance': float(dent.significance),
        'sightings': len(entry.sightings),
        'frame': entry.best,
        'verdict': verdict(findings),
        'limits': [
            {
                'measure': finding.limit.measure,
                'limit': finding.limit.text,
                'value': finding.value,
                'uncertainty': finding.uncertainty,
                'verdict': finding.verdict,
                'reference': finding.limit.reference,
            }
            for finding in findings
        ],
    }


def csv_text(record: dict[str, Any]) -> str:
    """Dents, bumps and steps of a report's record, a line each; empty cells are not known."""
    return table([*record['dents'], *record['others']], _COLUMNS)


def _frame_record(frame: ReportedCloud) -> dict[str, Any]:
    pose = frame.pose
    return {
        'number': frame.number,
        'name': frame.name,
        'time': None if frame.stamp_ns is None else iso_time(frame.stamp_ns),
        'stamp_ns': frame.stamp_ns,
        'measured_area_m2': frame.area,
        'noise_mm': frame.noise * 1e3,
        'findable_depth_mm': {
            'on_half_of_the_area': frame.findable[0] * 1e3,
            'on_95_percent_of_it': frame.findable[1] * 1e3,
        },
        'not_measured': None
        if frame.coverage is None
        else {'share': 1 - frame.coverage.share, 'reasons': dict(frame.coverage.missing)},
        'waviness': [
            {
                'amplitude_mm': wave.amplitude * 1e3,
                'wavelength_mm': wave.wavelength * 1e3,
                'area_m2': wave.area,
            }
            for wave in frame.waviness
        ],
        'dents': frame.dents,
        'others': frame.others,
        'pose': pose
        and {
            'position': [float(value) for value in pose.translation],
            'orientation_xyzw': [float(value) for value in pose.quaternion],
            'covariance': None
            if frame.covariance is None
            else [float(value) for value in np.ravel(frame.covariance)],
        },
    }
