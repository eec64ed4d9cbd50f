"""The user's limits, and what a measurement with its uncertainty says of them.

The file is YAML; none is shipped but the fictitious ``example_rules.yaml``, which explains it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated

import numpy as np

from ftp_dent_ros.dents.dent import COVERAGE, MeasuredDent
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.fields import Fields, Limits
from ftp_dent_ros.yaml_file import read_yaml

WITHIN, EXCEEDS, UNDECIDED = 'within', 'exceeds', 'cannot decide'
_DENSITY = 'dents_per_area'
# Of a cut dent these can only be larger.
_GROWING = ('depth_mm', 'length_mm', 'width_mm', 'area_mm2', 'volume_mm3')


MEASURES = (
    *('depth_mm', 'length_mm', 'width_mm', 'width_to_depth', 'area_mm2', 'volume_mm3'),
    *('clearance_mm', _DENSITY),
)


@dataclass(frozen=True)
class Limit:
    """One line of the rules.

    Attributes
    ----------
    measure : str
        One of `MEASURES`.
    minimum, maximum : float
        In the unit of the measure's name; infinite where there is none.
    reference : str
        Where the user has it from.
    area_m2 : float
        Of the circle in which dents are counted.

    Raises
    ------
    ConfigurationError
        They contradict each other.
    """

    measure: Annotated[str, Limits(choices=MEASURES)]
    minimum: float = -math.inf
    maximum: float = math.inf
    reference: str = ''
    area_m2: float = 0.0

    def __post_init__(self) -> None:
        if math.isinf(self.minimum) and math.isinf(self.maximum):
            raise ConfigurationError('measure has neither minimum nor maximum: give one of them')
        if self.minimum > self.maximum:
            raise ConfigurationError(
                f'minimum is {self.minimum:g}, above its maximum of {self.maximum:g}: correct one '
                'of them'
            )
        if (self.measure == _DENSITY) != (self.area_m2 > 0):
            raise ConfigurationError(
                f'area_m2 is {self.area_m2:g}: give a positive area for {_DENSITY}, and only there'
            )

    @property
    def text(self) -> str:
        """The limit as people write it."""
        ends = ('at least', self.minimum), ('at most', self.maximum)
        words = [f'{word} {value:g}' for word, value in ends if math.isfinite(value)]
        within = f' within {self.area_m2:g} m2' if self.measure == _DENSITY else ''
        return ', '.join(words) + within


@dataclass(frozen=True)
class Judgement:
    """A dent held against one limit; value and standard uncertainty in the measure's unit."""

    limit: Limit
    value: float
    uncertainty: float
    verdict: str


@dataclass(frozen=True)
class Rules:
    """Limits of the user's.

    Attributes
    ----------
    title, reference : str
    limits : tuple of Limit
    """

    title: str
    reference: str
    limits: tuple[Limit, ...]

    def judge(self, dents: Sequence[MeasuredDent]) -> list[tuple[Judgement, ...]]:
        """What the limits say of each dent among all of them."""
        return [
            tuple(_finding(limit, dent, dents) for limit in self.limits if dent.kind == 'dent')
            for dent in dents
        ]


def verdict(findings: Sequence[Judgement]) -> str | None:
    """The worst of the findings: exceeds, cannot decide, within; None without any."""
    found = {finding.verdict for finding in findings}
    return next((word for word in (EXCEEDS, UNDECIDED, WITHIN) if word in found), None)


def read_rules(path: str | os.PathLike[str]) -> Rules:
    """Read a file of limits.

    Raises
    ------
    ConfigurationError
        The file cannot be read, or a field is missing, unknown or malformed; it is named.
    """
    file = Fields(read_yaml(path, ConfigurationError), f'{path}: ')
    reference = file.take('reference', str, '')
    limits = [
        each.record(Limit, **({} if 'reference' in each else {'reference': reference}))
        for each in file.blocks('limits')
    ]
    if not limits:
        raise file.refusal('limits', limits, 'a list of one or more limits')
    rules = Rules(file.take('title', str, ''), reference, tuple(limits))
    file.finish()
    return rules


def _finding(limit: Limit, dent: MeasuredDent, dents: Sequence[MeasuredDent]) -> Judgement:
    if limit.measure == _DENSITY:
        count = float(_most_within(limit.area_m2, dent, dents))
        return Judgement(limit, count, 0.0, _verdict(limit, count, 0.0))
    estimate = dent.figure(limit.measure)
    value, sigma = estimate.value, estimate.uncertainty
    decided = _verdict(limit, value, sigma)
    if dent.is_cut and limit.measure != 'clearance_mm':
        certain = limit.measure in _GROWING and value - COVERAGE * sigma > limit.maximum
        decided = EXCEEDS if certain else UNDECIDED
    return Judgement(limit, value, sigma, decided)


def _verdict(limit: Limit, value: float, sigma: float) -> str:
    """Within or beyond the limit with the whole 95 % interval, or neither."""
    low, high = value - COVERAGE * sigma, value + COVERAGE * sigma
    if high < limit.minimum or low > limit.maximum:
        return EXCEEDS
    if low >= limit.minimum and high <= limit.maximum:
        return WITHIN
    return UNDECIDED


def _most_within(area: float, dent: MeasuredDent, dents: Sequence[MeasuredDent]) -> int:
    """Largest number of dents whose centres a circle of that area can take with this one."""
    radius = math.sqrt(area / math.pi)
    across = np.cross(dent.normal, dent.axis)
    apart = np.array([d.position - dent.position for d in dents if d.kind == 'dent'])
    flat = apart @ np.stack([dent.axis, across], axis=1)
    flat = flat[np.linalg.norm(apart, axis=1) <= 2 * radius]
    # A circle that takes the most can be moved until two centres lie on its rim.
    centres = list(flat)
    for a, b in combinations(flat, 2):
        half = (b - a) / 2
        rest = radius**2 - half @ half
        if rest >= 0 and half.any():
            normal = np.array([-half[1], half[0]]) / np.linalg.norm(half) * math.sqrt(rest)
            centres += [a + half + normal, a + half - normal]
    reach = radius + 1e-9
    counts = [
        int((np.linalg.norm(flat - centre, axis=1) <= reach).sum())
        for centre in centres
        if np.linalg.norm(centre) <= reach
    ]
    return max(counts, default=1)
