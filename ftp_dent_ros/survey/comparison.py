"""What has become of the dents between two surveys of one aircraft."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ftp_dent_ros import __version__
from ftp_dent_ros.dents.dent import COVERAGE, Estimate
from ftp_dent_ros.dents.rules import Judgement, Rules, verdict
from ftp_dent_ros.dents.sightings import CENTRE, agreement, assigned, sigmas_apart
from ftp_dent_ros.pages.drawing import scale_bar
from ftp_dent_ros.pages.page import render
from ftp_dent_ros.pages.words import date_of, finite, interval, position_interval, spread, table
from ftp_dent_ros.rigid import Array
from ftp_dent_ros.survey.aircraft_frame import AircraftFrame
from ftp_dent_ros.survey.growth import Change, changes_of, depth_growth
from ftp_dent_ros.survey.matching import DentMatching, match
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult
from ftp_dent_ros.survey.unrolled import Unrolled

#: In words, in the order in which they are listed.
STATUSES = {
    'grown': 'larger than before, beyond what noise can be',
    'new': 'was not there when the place was looked at before',
    'first seen': 'its place was not looked at before, or not well enough to find it',
    'repaired': 'is not there any more, though its place was looked at well enough to find it',
    'shallower': 'smaller than before, beyond what noise can be',
    'changed': 'larger in one measure and smaller in another, beyond what noise can be',
    'not seen': 'its place was not looked at this time, or not well enough to find it',
    'in doubt': 'may be the same as before: its place is not known well enough to tell',
    'known': 'as before, as far as can be known',
}
# By the signs of what has changed.
_BY_SIGNS = {
    frozenset(): 'known',
    frozenset({1}): 'grown',
    frozenset({-1}): 'shallower',
    frozenset({1, -1}): 'changed',
}
# What is compared: these are damage; steps, bumps and what is none of these are not.
_DAMAGE = {'dent', 'crease', 'gouge'}
# Standard deviations of a place in the other survey, around which it must have been looked at.
_AROUND = 3.0


# Of the map and its margin, the drawing's units.
_WIDTH, _MARGIN = 1000.0, 40.0


@dataclass(frozen=True, eq=False)
class ComparedDent:
    """One dent in both surveys, or in one of them.

    Attributes
    ----------
    status : str
        One of `STATUSES`.
    earlier, later : SurveyedDent, optional
        In the later survey's frame.
    changes : mapping of str to Change
        By the quantity: of one that is whole in both.
    reason : str
        Why nothing more can be said.
    """

    status: str
    earlier: SurveyedDent | None
    later: SurveyedDent | None
    changes: Mapping[str, Change]
    reason: str = ''

    @property
    def shown(self) -> SurveyedDent:
        """As it was seen last."""
        shown = self.later or self.earlier
        assert shown is not None
        return shown

    @property
    def number(self) -> str:
        """In the later survey; where it is not there, in the earlier one, in brackets."""
        return str(self.shown.number) if self.later else f'({self.shown.number})'


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two surveys, laid on each other.

    Attributes
    ----------
    earlier, later : SurveyResult
    dents : tuple of ComparedDent
        In the order of `STATUSES`, the deepest first.
    matching : DentMatching
    scales : mapping of str to Estimate
        By the quantity: the factor of the later survey's values.
    frame : AircraftFrame, optional
        In which locations are given.
    rules : Rules, optional
    """

    earlier: SurveyResult
    later: SurveyResult
    dents: tuple[ComparedDent, ...]
    matching: DentMatching
    scales: Mapping[str, Estimate]
    frame: AircraftFrame | None = None
    rules: Rules | None = None

    @cached_property
    def findings(self) -> dict[str, tuple[Judgement, ...]]:
        """What the limits say of the dents that are there, by their numbers."""
        there = {each.number: each.later.dent for each in self.dents if each.later}
        judged = self.rules.judge(list(there.values())) if self.rules else ()
        return dict(zip(there, judged, strict=False))

    def located(self, each: ComparedDent) -> tuple[Array, float]:
        """Location of a dent, shape (3,), and its standard uncertainty along its worst direction.

        Station, buttock line and water line, or a place in the later survey's frame; metres.
        """
        place, covariance = each.shown.dent.position, each.shown.position_covariance
        if self.frame is not None:
            carried = 0.0 if each.later else self.matching.spread(place)
            place, covariance = self.frame.place(place, CENTRE**2 + carried**2)
        return place, math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))

    def first_seen(self, each: ComparedDent) -> str:
        """Date."""
        return date_of((self.earlier if each.earlier else self.later).taken_ns)


def compare(
    earlier: SurveyResult,
    later: SurveyResult,
    frame: AircraftFrame | None = None,
    rules: Rules | None = None,
) -> Comparison:
    """Compare two surveys of one aircraft.

    Parameters
    ----------
    earlier, later : SurveyResult
    frame : AircraftFrame, optional
        Of the later survey's frame; locations are given in it.
    rules : Rules, optional
        Limits for the dents that are there.

    Raises
    ------
    NoMatchError
        They cannot be laid on each other.
    """
    before, after = (
        [each for each in survey.dents if each.dent.kind != 'step'] for survey in (earlier, later)
    )
    matching = match([each.dent for each in before], [each.dent for each in after])
    # From here on all is in the later survey's frame.
    before = [_carried(each, matching) for each in before]
    cells = matching.in_later(earlier.coverage.positions.astype(float)).astype(np.float32)
    looked = replace(earlier, coverage=replace(earlier.coverage, positions=cells))
    same = [(before[i], after[j]) for i, j in matching.pairs]
    deeper = [depth_growth(a, b) for a, b in same]
    changes, scales = changes_of([a.dent for a, _ in same], [b.dent for _, b in same], deeper)
    found = []
    for (a, b), change in zip(same, changes, strict=True):
        status = _BY_SIGNS[frozenset(each.verdict for each in change.values()) - {0}]
        cut = '' if change else 'cut by the edge of what was measured: not compared'
        found.append(ComparedDent(status, a, b, change, cut))
    for side, (dents, other) in enumerate(((before, later), (after, looked))):
        paired = {pair[side] for pair in matching.pairs}
        alone = [dent for index, dent in enumerate(dents) if index not in paired]
        found += [_alone(dent, other, matching, is_gone=not side) for dent in alone]
    found = [
        each
        for each in found
        if any(dent and dent.dent.kind in _DAMAGE for dent in (each.earlier, each.later))
    ]
    found = _with_doubts(found)
    order = list(STATUSES)
    found.sort(
        key=lambda each: (
            order.index(each.status),
            -np.nan_to_num(abs(each.shown.dent.depth.value)),
        )
    )
    return Comparison(earlier, later, tuple(found), matching, scales, frame, rules)


def _carried(each: SurveyedDent, matching: DentMatching) -> SurveyedDent:
    """A dent of the earlier survey in the later one's frame."""
    move = matching.near(each.dent.position)
    dent, turn = each.dent.transformed(move), move.rotation.as_matrix()
    known = turn @ each.position_covariance @ turn.T
    known = known + matching.spread(dent.position) ** 2 * np.eye(3)
    return replace(each, dent=dent, position_covariance=known)


def _alone(
    dent: SurveyedDent, other: SurveyResult, matching: DentMatching, is_gone: bool
) -> ComparedDent:
    """A dent of the earlier survey that is gone in the other; or of the later, come since."""
    reason = _why_not_found(dent, other, matching.spread(dent.dent.position))
    if is_gone:
        return ComparedDent('not seen' if reason else 'repaired', dent, None, {}, reason)
    return ComparedDent('first seen' if reason else 'new', None, dent, {}, reason)


def _with_doubts(found: list[ComparedDent]) -> list[ComparedDent]:
    """Those once that may be one dent in both surveys: neither tells that they are two."""
    unseen, first = (
        [each for each in found if each.status == status] for status in ('not seen', 'first seen')
    )
    if not (unseen and first):
        return found
    before, after = [each.shown for each in unseen], [each.shown for each in first]
    apart = np.array([[b.dent.position - a.dent.position for b in after] for a in before])
    both = np.array(
        [[a.position_covariance + b.position_covariance for b in after] for a in before]
    )
    far = sigmas_apart(apart, both)
    alike = np.isfinite(agreement([each.dent for each in before], [each.dent for each in after]))
    pairs = list(zip(*assigned(np.where(alike & (far < _AROUND), far, np.inf)), strict=True))
    doubts = [
        ComparedDent(
            'in doubt',
            before[i],
            after[j],
            {},
            f'may be number {before[i].number} of before: '
            f'{1e3 * float(np.linalg.norm(apart[i, j])):.0f} mm from it, where the places are '
            f'known within {position_interval(both[i, j])}',
        )
        for i, j in pairs
    ]
    taken = [each for i, j in pairs for each in (unseen[i], first[j])]
    return [*(each for each in found if each not in taken), *doubts]


def _why_not_found(dent: SurveyedDent, survey: SurveyResult, spread: float) -> str:
    """Why a survey cannot say that a dent was not there; empty if it can."""
    if dent.dent.is_cut:
        return 'cut by the edge of what was measured'
    width = float(np.nan_to_num(dent.dent.width.value))
    depth, around = dent.dent.depth, _AROUND * spread + width / 2
    findable = survey.coverage.found_around(dent.dent.position, dent.dent.normal, around)
    if not np.isfinite(findable):
        return f'not all of its place was measured in the survey {survey.name}'
    findable = max(findable, survey.settings.smallest_depth)
    # A dent would have been found for certain if it is so many times as deep as the findable
    # depth, after twice its uncertainty: what the smallest width, on which that stands, may cost.
    if abs(depth.value) - 2.0 * depth.uncertainty < 1.5 * findable:
        return (
            f'in the survey {survey.name} only dents from {findable * 1e3:.2f} mm depth on would '
            'have been found there'
        )
    if width < survey.settings.smallest_width:
        return f'the survey {survey.name} looked for wider dents only'
    return ''


def chart_csv(comparison: Comparison) -> str:
    """The chart, a line a dent, millimetres; empty cells are not known."""
    names = ('station', 'buttock_line', 'water_line') if comparison.frame else ('x', 'y', 'z')
    records = []
    for each in comparison.dents:
        dent, findings = each.shown.dent, comparison.findings.get(each.number, ())
        worst, (location, uncertainty) = verdict(findings), comparison.located(each)
        record: dict[str, Any] = {
            'number': each.number,
            'status': each.status,
            'kind': dent.kind,
            **{f'{n}_mm': float(v) * 1e3 for n, v in zip(names, location, strict=True)},
            'location_uncertainty_mm': uncertainty * 1e3,
        }
        record |= dent.figures(
            ('length_mm', 'width_mm', 'depth_mm', 'width_to_depth', 'clearance_mm')
        )
        for quantity in ('depth', 'length', 'width'):
            change = each.changes.get(quantity)
            record[f'{quantity}_growth_mm'] = change and change.estimate.value * 1e3
            record[f'{quantity}_growth_95_percent_mm'] = change and change.half * 1e3
        record |= {
            'date_first_seen': comparison.first_seen(each),
            'number_before': None if each.earlier is None else each.earlier.number,
            'limit': worst,
            'reference': '; '.join(
                dict.fromkeys(f.limit.reference for f in findings if f.verdict == worst)
            ),
            'is_cut': dent.is_cut,
            'remark': each.reason,
        }
        records.append(finite(record))
    return table(records, list(records[0]) if records else [])


def comparison_page(comparison: Comparison) -> str:
    """The whole page as HTML."""
    groups = [
        {'status': status, 'meaning': meaning, 'rows': found}
        for status, meaning in STATUSES.items()
        if (
            found := [
                _cells(each, comparison) for each in comparison.dents if each.status == status
            ]
        )
    ]
    return render(
        'ftp_dent_ros.survey',
        'comparison.html',
        earlier=comparison.earlier,
        later=comparison.later,
        headline=headline(comparison.dents) or 'No dents',
        facts=_facts(comparison),
        groups=groups,
        map=_map(comparison),
        location='Station, buttock line, water line' if comparison.frame else 'Location x, y, z',
        rules=comparison.rules,
    )


def headline(dents: Sequence[ComparedDent]) -> str:
    """How many of each status."""
    counts = Counter(each.status for each in dents)
    return ', '.join(f'{counts[each]} {each}' for each in STATUSES if counts[each])


def _facts(comparison: Comparison) -> list[tuple[str, str]]:
    matching, frame = comparison.matching, comparison.frame
    scales = ', '.join(
        f'{quantity} {100 * (each.value - 1):+.2f} ± {100 * COVERAGE * each.uncertainty:.2f} %'
        for quantity, each in comparison.scales.items()
    )
    facts = [
        *(
            (f'{word} survey', f'{each.name}, {date_of(each.taken_ns)}, {each.count} dents')
            for word, each in (('Earlier', comparison.earlier), ('Later', comparison.later))
        ),
        ('In both', f'{len(matching.pairs)} dents, by which the surveys lie on each other'),
        ('Later sees larger', f'{scales}; taken out of every growth'),
    ]
    if frame is not None:
        points = f'by {len(frame.residuals)} points, within {frame.worst * 1e3:.1f} mm of it'
        facts.append(('Aircraft frame', points))
    return [*facts, ('Software', f'ftp_dent_ros {__version__}')]


def _cells(row: ComparedDent, comparison: Comparison) -> dict[str, Any]:
    location, uncertainty = comparison.located(row)
    dent, change, signed = row.shown.dent, row.changes.get('depth'), ('–', '')
    if change and change.estimate.is_measured and math.isfinite(change.half):
        signed = f'{change.estimate.value * 1e3:+.3f}', f'± {change.half * 1e3:.3f}'
    return {
        'number': row.number,
        'before': '' if row.earlier is None else str(row.earlier.number),
        'kind': dent.kind,
        'depth': interval(dent.depth, finest=3),
        'length': interval(dent.length),
        'width': interval(dent.width),
        'ratio': interval(dent.width_to_depth, 1.0),
        'clearance': interval(dent.clearance_estimate, finest=1),
        'growth': signed,
        'location': [f'{value:.3f}' for value in location],
        'spread': spread(uncertainty),
        'first_seen': comparison.first_seen(row),
        'verdict': verdict(comparison.findings.get(row.number, ())),
        'cut': dent.is_cut,
        'others': '; '.join(
            f'{quantity} {each.estimate.value * 1e3:+.2f} ± {each.half * 1e3:.2f} mm'
            for quantity, each in row.changes.items()
            if quantity != 'depth' and each.verdict
        ),
        'reason': row.reason,
    }


def _map(comparison: Comparison) -> dict[str, Any] | None:
    """Where the dents lie on the unrolled skin, as seen from outside."""
    rows = comparison.dents
    # Fewer tell no skin.
    if len(rows) < 3:
        return None
    places = np.array([row.shown.dent.position for row in rows])
    normals = np.array([row.shown.dent.normal for row in rows])
    flat = Unrolled.through(places, normals).place(places)[:, :2] * (1, -1)
    low, size = flat.min(axis=0), np.maximum(np.ptp(flat, axis=0), 1e-3)
    scale = min((_WIDTH - 2 * _MARGIN) / size[0], (0.7 * _WIDTH - 2 * _MARGIN) / size[1])
    at = (flat - low) * scale + _MARGIN
    return {
        'width': _WIDTH,
        'height': max(size[1] * scale, _MARGIN) + 2 * _MARGIN,
        'dents': [
            {
                'x': f'{x:.1f}',
                'y': f'{y:.1f}',
                'number': row.number,
                'status': row.status.replace(' ', '-'),
            }
            # What stands out is drawn last.
            for row, (x, y) in reversed(list(zip(rows, at, strict=True)))
        ],
        'bar': scale_bar(1 / scale, _WIDTH),
    }
