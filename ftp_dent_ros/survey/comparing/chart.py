"""The dent and buckle chart of a comparison: a row a dent, as data and as CSV."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent
from ftp_dent_ros.inspection.reporting.rules import (
    Finding,
    Rules,
    clearance,
    verdict,
    width_to_depth,
)
from ftp_dent_ros.survey.aircraft_frame import AircraftFrame
from ftp_dent_ros.survey.comparing.comparison import ComparedDent, Comparison

_MM = 1e3
# What a dent's place among the others is known to, without drift: metres.
_PLACE = 4e-4


@dataclass(frozen=True, eq=False)
class Row:
    """One dent of the chart.

    Attributes
    ----------
    compared : ComparedDent
    number : str
        That of the later survey; where it is not there, that of the earlier one, in brackets.
    location : ndarray, shape (3,)
        Station, buttock line and water line, or a place in the later survey's frame; metres.
    uncertainty : float
        Standard uncertainty of that along its worst direction, metres.
    first_seen : str
        Date.
    findings : tuple of Finding
        What the user's limits say of it.
    """

    compared: ComparedDent
    number: str
    location: NDArray[np.float64]
    uncertainty: float
    first_seen: str
    findings: tuple[Finding, ...]

    @property
    def dent(self) -> MeasuredDent:
        """As it was seen last."""
        return self.compared.shown.dent


def chart(
    comparison: Comparison, frame: AircraftFrame | None = None, rules: Rules | None = None
) -> list[Row]:
    """Rows in the order of the comparison.

    Parameters
    ----------
    comparison : Comparison
    frame : AircraftFrame, optional
        Of the later survey's frame; locations are given in it.
    rules : Rules, optional
        Limits for the dents that are there.
    """
    there = [each for each in comparison.dents if each.later is not None]
    findings: dict[int, tuple[Finding, ...]] = {}
    if rules is not None:
        judged = rules.judge([each.shown.dent for each in there])
        findings = {id(each): found for each, found in zip(there, judged, strict=True)}
    return [_row(each, comparison, frame, findings.get(id(each), ())) for each in comparison.dents]


def _row(
    each: ComparedDent,
    comparison: Comparison,
    frame: AircraftFrame | None,
    findings: tuple[Finding, ...],
) -> Row:
    shown = each.shown
    place, among = shown.dent.position, _PLACE
    if each.later is None:
        places, spread = comparison.matching.in_later(place[None])
        place, among = places[0], math.hypot(_PLACE, float(spread[0]))
    covariance = shown.position_covariance
    if frame is not None:
        place, covariance = frame.place(place, np.eye(3) * among**2)
    first = comparison.later if each.earlier is None else comparison.earlier
    return Row(
        each,
        str(shown.number) if each.later is not None else f'({shown.number})',
        place,
        math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])),
        date_of(first.taken_ns),
        findings,
    )


def date_of(nanoseconds: int) -> str:
    """UTC, ISO 8601."""
    return datetime.fromtimestamp(nanoseconds / 1e9, timezone.utc).date().isoformat()


def chart_record(row: Row, on_aircraft: bool) -> dict[str, Any]:
    """A row's cells: millimetres; None where there is nothing."""
    dent, compared = row.dent, row.compared
    names = ('station', 'buttock_line', 'water_line') if on_aircraft else ('x', 'y', 'z')
    record: dict[str, Any] = {
        'number': row.number,
        'status': compared.status,
        'kind': dent.kind,
        **{f'{n}_mm': float(v) * _MM for n, v in zip(names, row.location, strict=True)},
        'location_uncertainty_mm': row.uncertainty * _MM,
    }
    for name, estimate, factor, unit in (
        ('length', dent.length, _MM, '_mm'),
        ('width', dent.width, _MM, '_mm'),
        ('depth', dent.depth, _MM, '_mm'),
        ('width_to_depth', width_to_depth(dent), 1.0, ''),
        ('clearance', clearance(dent), _MM, '_mm'),
    ):
        record[f'{name}{unit}'] = estimate.value * factor
        record[f'{name}_uncertainty{unit}'] = estimate.uncertainty * factor
    for change in compared.changes:
        record[f'{change.quantity}_growth_mm'] = change.estimate.value * _MM
        record[f'{change.quantity}_growth_95_percent_mm'] = change.half * _MM
    worst = verdict(row.findings)
    record |= {
        'date_first_seen': row.first_seen,
        'number_before': None if compared.earlier is None else compared.earlier.number,
        'limit': worst,
        'reference': '; '.join(
            dict.fromkeys(f.limit.reference for f in row.findings if f.verdict == worst)
        ),
        'is_cut': dent.is_cut,
        'remark': compared.reason,
    }
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in record.items()
    }


def chart_csv(rows: list[Row], on_aircraft: bool) -> str:
    """The chart, a line a dent; empty cells are not known."""
    empty = [
        f'{q}_growth{u}_mm' for q in ('depth', 'length', 'width') for u in ('', '_95_percent')
    ]
    records = [chart_record(row, on_aircraft) for row in rows]
    names = list(records[0]) if records else ['number', 'status']
    names = [name for name in names if name not in empty]
    at = names.index('date_first_seen') if 'date_first_seen' in names else len(names)
    text = io.StringIO()
    writer = csv.DictWriter(text, [*names[:at], *empty, *names[at:]], lineterminator='\n')
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()


def growth_of(row: Row, quantity: str = 'depth') -> tuple[Estimate, float] | None:
    """Change of a quantity and half its 95 % interval, metres; None where it is not compared."""
    for change in row.compared.changes:
        if change.quantity == quantity:
            return change.estimate, change.half
    return None
