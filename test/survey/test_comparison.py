"""What has become of dents between two surveys, each in a frame of its own."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from survey_samples import COUNT, ELSEWHERE, GROWN, NEW, REPAIRED, UNSEEN, pair

from ftp_dent_ros.survey.comparison import chart_csv, compare, comparison_page
from ftp_dent_ros.survey.matching import NoMatchError, match
from ftp_dent_ros.survey.result import CoverageCells

NOWHERE = CoverageCells(0.01, np.zeros((1, 3), np.float32), np.full(1, np.nan))
EXPECTED = {GROWN: 'grown', REPAIRED: 'repaired', NEW: 'new', UNSEEN: 'not seen'}


def told(comparison):
    assert all(
        each.earlier is None or each.later is None or each.earlier.number == each.later.number
        for each in comparison.dents
    )
    return {each.shown.number: each.status for each in comparison.dents}


def test_each_dent_is_told_right_wherever_the_aircraft_stands():
    comparison = compare(*pair())
    assert told(comparison) == {
        number: EXPECTED.get(number, 'known') for number in range(1, COUNT + 1)
    }
    grown = comparison.dents[0]
    assert grown.status == 'grown'
    depth = grown.changes['depth']
    assert abs(depth.estimate.value - 5e-5) < 2 * depth.half
    places, spread = comparison.matching.in_earlier(ELSEWHERE.apply(np.array([[0.6, 0.3, 0.0]])))
    np.testing.assert_allclose(places[0], [0.6, 0.3, 0.0], atol=4 * spread[0])
    assert spread[0] < 1e-3


def test_surveys_of_bumps_alone_have_nothing_to_chart():
    bumps = (
        replace(
            survey,
            dents=tuple(replace(d, dent=replace(d.dent, kind='bump')) for d in survey.dents),
        )
        for survey in pair()
    )
    comparison = compare(*bumps)
    assert comparison.dents == () and chart_csv(comparison).strip() == ''
    assert 'No dents' in comparison_page(comparison)


def test_a_dent_that_would_hardly_have_been_found_is_not_new():
    earlier, later = pair()
    blunt = replace(earlier.coverage, findable=np.full_like(earlier.coverage.findable, 5e-3))
    comparison = compare(replace(earlier, coverage=blunt), later)
    assert told(comparison)[NEW] == 'first seen'


def test_surveys_of_two_aircraft_are_refused():
    for seed in range(3):
        (one, _), (_, other) = pair(seed), pair(seed + 10)
        with pytest.raises(NoMatchError, match='same aircraft'):
            match([each.dent for each in one.dents], [each.dent for each in other.dents])
    few = [each.dent for each in pair()[0].dents[:2]]
    with pytest.raises(NoMatchError, match='too few'):
        match(few, few)


def test_dents_nearer_than_their_places_are_known_are_one_in_doubt():
    earlier, later = pair()
    off = {number: np.array([0.02 + 0.01 * k, 0.03, 0.0]) for k, number in enumerate((8, 9, 10))}

    def loose(survey, shift=lambda number: np.zeros(3)):
        dents = [
            replace(
                each,
                dent=replace(each.dent, position=each.dent.position + shift(each.number)),
                position_covariance=np.eye(3) * 0.086**2,
            )
            for each in survey.dents
            if each.number not in (1, 2, 3, 4)
        ]
        return replace(survey, dents=tuple(dents), coverage=NOWHERE)

    found = compare(loose(earlier), loose(later, lambda n: off.get(n, np.zeros(3))))
    counts = Counter(each.status for each in found.dents)
    assert counts == {'known': COUNT - 7, 'in doubt': 3}
    for each in found.dents:
        if each.status == 'in doubt':
            assert each.earlier.number == each.later.number
            assert f'may be number {each.earlier.number} of before' in each.reason
