from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import pytest

from ftp_dent_ros.errors import NoPatternError, PatternChangeError
from ftp_dent_ros.pattern.history import PatternHistory
from ftp_dent_ros.pattern.pattern import Pattern

TEN = Pattern(320, 200, 10.0, 160.0)
EIGHT = replace(TEN, period_px=8.0)
MOVED = replace(EIGHT, stripe_center_px=150.0)
MS = 1_000_000


def history(*entries, settling_ms=250):
    patterns = PatternHistory(settling_ms * MS, lambda: 0)
    for stamp_ms, pattern in entries:
        patterns.add(stamp_ms * MS, pattern)
    return patterns


@pytest.mark.parametrize('order', list(permutations([(1000, TEN), (2000, EIGHT), (3000, MOVED)])))
def test_a_photograph_goes_with_the_pattern_of_its_time_in_whatever_order_they_come(order):
    patterns = history(*order)
    for stamp_ms, pattern in (
        (1250, TEN),
        (1750, TEN),
        (2250, EIGHT),
        (2750, EIGHT),
        (9999, MOVED),
    ):
        assert patterns.at(stamp_ms * MS) == pattern
    assert patterns.latest == MOVED


@pytest.mark.parametrize(
    'stamp_ms, words',
    [
        (1751, 'taken 249 ms before the period changed from 10 to 8 px'),
        (2000, 'taken 0 ms after the period changed from 10 to 8 px'),
        (2249, 'taken 249 ms after the period changed from 10 to 8 px'),
        (2800, 'taken 200 ms before the pattern changed'),
        (1100, 'taken 100 ms after the first pattern that is known'),
    ],
)
def test_around_a_change_it_is_refused_with_the_two_numbers(stamp_ms, words):
    patterns = history((1000, TEN), (2000, EIGHT), (3000, MOVED))
    with pytest.raises(PatternChangeError, match=words):
        patterns.at(stamp_ms * MS)


def test_the_same_pattern_again_is_no_change_and_hides_none():
    patterns = history((1000, TEN), (2000, EIGHT), (2100, EIGHT), (5000, EIGHT))
    assert patterns.at(5001 * MS) == EIGHT
    with pytest.raises(PatternChangeError, match='taken 200 ms after the period'):
        patterns.at(2200 * MS)


def test_what_is_not_known_is_refused():
    patterns = history()
    with pytest.raises(NoPatternError, match='start pattern_publisher'):
        patterns.at(5000 * MS)
    patterns.add(10_000 * MS, TEN)
    with pytest.raises(NoPatternError, match='000 s older than the oldest pattern'):
        patterns.at(5000 * MS)
    with pytest.raises(NoPatternError, match='no stamp'):
        patterns.at(0)
    assert patterns.at(20_000 * MS) == TEN
    patterns.forget('it is garbled')
    with pytest.raises(NoPatternError, match='it is garbled'):
        patterns.at(20_000 * MS)
    assert patterns.latest is None
    # A pattern of long ago, latched, and photographs of now.
    patterns.add(10_000 * MS, EIGHT)
    assert patterns.at(10**9 * MS) == EIGHT


def test_a_loop_of_a_bag_adds_nothing_and_the_oldest_of_many_are_forgotten():
    patterns = history(*[(1000 + 1000 * (i % 2), (TEN, EIGHT)[i % 2]) for i in range(200)])
    assert patterns.at(1500 * MS) == TEN and patterns.at(2500 * MS) == EIGHT
    for i in range(100):
        patterns.add((3000 + 1000 * i) * MS, (TEN, EIGHT)[i % 2])
    with pytest.raises(NoPatternError, match='older'):
        patterns.at(1500 * MS)
    assert patterns.at(102_500 * MS) == EIGHT


@pytest.mark.parametrize('step_s', [-3600, -3, 3, 3600])
def test_a_step_of_the_clock_costs_no_photograph_and_brings_no_pattern_back(step_s):
    clock = [0]
    patterns = PatternHistory(250 * MS, lambda: clock[0])
    patterns.add(4_000_000 * MS, TEN)
    clock[0] += step_s * 1000 * MS
    now_ms = 4_010_000 + step_s * 1000
    assert patterns.at(now_ms * MS) == TEN
    patterns.add((now_ms + 1000) * MS, EIGHT)
    assert patterns.latest == EIGHT
    assert patterns.at((now_ms + 2000) * MS) == EIGHT
