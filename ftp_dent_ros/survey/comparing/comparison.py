"""What has become of the dents between two surveys of one aircraft."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ftp_dent_ros.inspection.dent import Estimate
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.comparing.growth import Change, Scale, changes_of
from ftp_dent_ros.survey.comparing.matching import Matching, match
from ftp_dent_ros.survey.comparing.relief_growth import Growth, growth_of
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult

Status = Literal[
    'known', 'grown', 'shallower', 'new', 'first seen', 'repaired', 'not seen', 'changed'
]
#: In words, in the order in which they are listed.
STATUSES: dict[Status, str] = {
    'grown': 'larger than before, beyond what noise can be',
    'new': 'was not there when the place was looked at before',
    'first seen': 'its place was not looked at before, or not well enough to find it',
    'repaired': 'is not there any more, though its place was looked at well enough to find it',
    'shallower': 'smaller than before, beyond what noise can be',
    'changed': 'larger in one measure and smaller in another, beyond what noise can be',
    'not seen': 'its place was not looked at this time, or not well enough to find it',
    'known': 'as before, as far as can be told',
}
# What is compared: these are damage; steps, bumps and what is none of these are not.
DAMAGE = ('dent', 'crease', 'gouge')
# A dent would have been found for certain if it is so many times as deep as the findable depth,
# after twice its uncertainty: what the smallest width, on which that stands, may cost.
_CERTAIN, _SURE = 1.5, 2.0
# Standard deviations of a place in the other survey, around which it must have been looked at.
_AROUND = 3.0


@dataclass(frozen=True, eq=False)
class ComparedDent:
    """One dent in both surveys, or in one of them.

    Attributes
    ----------
    status : str
        One of `STATUSES`.
    earlier, later : SurveyedDent, optional
    changes : tuple of Change
        Of one that is whole in both.
    reason : str
        Why nothing more can be said.
    """

    status: Status
    earlier: SurveyedDent | None
    later: SurveyedDent | None
    changes: tuple[Change, ...] = ()
    reason: str = ''

    @property
    def shown(self) -> SurveyedDent:
        """As it was seen last."""
        shown = self.later or self.earlier
        assert shown is not None
        return shown


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two surveys, laid on each other.

    Attributes
    ----------
    earlier, later : SurveyResult
    dents : tuple of ComparedDent
        In the order of `STATUSES`, the deepest first.
    matching : Matching
    scales : tuple of Scale
    """

    earlier: SurveyResult
    later: SurveyResult
    dents: tuple[ComparedDent, ...]
    matching: Matching
    scales: tuple[Scale, ...]


def compare(earlier: SurveyResult, later: SurveyResult) -> Comparison:
    """Compare two surveys of one aircraft.

    Raises
    ------
    NoMatchError
        They cannot be laid on each other.
    """
    before, after = _compared(earlier), _compared(later)
    matching = match([each.dent for each in before], [each.dent for each in after])
    same = [(before[i], after[j]) for i, j in matching.pairs]
    deeper = [_deeper(a, b, matching) for a, b in same]
    changes, scales = changes_of([a.dent for a, _ in same], [b.dent for _, b in same], deeper)
    found = [
        _matched(a, b, change)
        for (a, b), change in zip(same, changes, strict=True)
        if a.dent.kind in DAMAGE or b.dent.kind in DAMAGE
    ]
    gone = _others(before, {i for i, _ in matching.pairs})
    come = _others(after, {j for _, j in matching.pairs})
    found += [_gone(each, later, matching) for each in gone]
    found += [_come(each, earlier, matching) for each in come]
    order = list(STATUSES)
    found.sort(key=lambda each: (order.index(each.status), -_depth(each)))
    return Comparison(earlier, later, tuple(found), matching, scales)


def _deeper(earlier: SurveyedDent, later: SurveyedDent, matching: Matching) -> Growth | None:
    """How much deeper a dent is by the skin about it, outward for what stands out."""
    turn = matching.motion.rotation.inv()
    places, _ = matching.in_later(earlier.dent.position[None])
    to_later = Pose(turn, places[0] - turn.apply(earlier.dent.position))
    deeper = growth_of(earlier, later, to_later)
    if deeper is None:
        return None
    sign = float(np.sign(earlier.dent.depth.value))
    return replace(
        deeper, estimate=Estimate(sign * deeper.estimate.value, deeper.estimate.uncertainty)
    )


def _depth(each: ComparedDent) -> float:
    return float(np.nan_to_num(abs(each.shown.dent.depth.value)))


def _compared(survey: SurveyResult) -> list[SurveyedDent]:
    return [each for each in survey.dents if each.dent.kind != 'step']


def _others(dents: list[SurveyedDent], matched: set[int]) -> list[SurveyedDent]:
    return [
        each
        for index, each in enumerate(dents)
        if index not in matched and each.dent.kind in DAMAGE
    ]


def _matched(
    earlier: SurveyedDent, later: SurveyedDent, changes: tuple[Change, ...]
) -> ComparedDent:
    if not changes:
        return ComparedDent(
            'known', earlier, later, (), 'cut by the edge of what was measured: not compared'
        )
    signs = {change.verdict for change in changes} - {0}
    status: Status = 'known'
    if signs == {1}:
        status = 'grown'
    elif signs == {-1}:
        status = 'shallower'
    elif signs:
        status = 'changed'
    return ComparedDent(status, earlier, later, changes)


def _gone(dent: SurveyedDent, later: SurveyResult, matching: Matching) -> ComparedDent:
    places, spread = matching.in_later(dent.dent.position[None])
    normal = matching.motion.rotation.inv().apply(dent.dent.normal)
    reason = _not_looked_at(dent, later, places[0], normal, float(spread[0]))
    return ComparedDent('not seen' if reason else 'repaired', dent, None, (), reason)


def _come(dent: SurveyedDent, earlier: SurveyResult, matching: Matching) -> ComparedDent:
    places, spread = matching.in_earlier(dent.dent.position[None])
    normal = matching.motion.rotation.apply(dent.dent.normal)
    reason = _not_looked_at(dent, earlier, places[0], normal, float(spread[0]))
    return ComparedDent('first seen' if reason else 'new', None, dent, (), reason)


def _not_looked_at(
    dent: SurveyedDent, survey: SurveyResult, place: np.ndarray, normal: np.ndarray, spread: float
) -> str:
    """Why a survey cannot say that a dent was not there; empty if it can."""
    if survey.coverage is None:
        return f'the survey {survey.name} keeps no coverage'
    if dent.dent.is_cut:
        return 'cut by the edge of what was measured'
    width = float(np.nan_to_num(dent.dent.width.value))
    depth = dent.dent.depth
    findable = survey.coverage.found_around(place, normal, _AROUND * spread + width / 2)
    if not np.isfinite(findable):
        return f'not all of its place was measured in the survey {survey.name}'
    findable = max(findable, survey.settings.smallest_depth)
    if abs(depth.value) - _SURE * depth.uncertainty < _CERTAIN * findable:
        return (
            f'in the survey {survey.name} only dents from {findable * 1e3:.2f} mm depth on would '
            'have been found there'
        )
    if width < survey.settings.smallest_width:
        return f'the survey {survey.name} looked for wider dents only'
    return ''
