"""Probability of detection: statistics, trials, the page."""

import json

import numpy as np
import pytest

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.evaluation.detection import (
    Trial,
    blanks_of,
    detection,
    most_calls,
    rows_of,
    sentence,
)


def drawn(count, seed, a90=2e-4, steepness=6.0):
    rng = np.random.default_rng(seed)
    depths, widths = np.exp(rng.uniform(np.log(2e-5), np.log(2e-3), count)), np.full(count, 0.03)
    logit = np.log(9) + steepness * np.log(depths / a90)
    return depths, widths, (rng.random(count) < 1 / (1 + np.exp(-logit))).astype(float)


def test_the_depth_that_is_found_in_90_percent_is_below_its_bound_in_95():
    found = [detection(*drawn(80, seed)) for seed in range(40)]
    assert np.median([each.a90 for each in found]) == pytest.approx(2e-4, rel=0.1)
    # 38 of 40 on average; 35 or more in 98 % of such sets.
    assert sum(each.a90_95 > 2e-4 for each in found) >= 35
    assert all(each.a90 < each.a90_95 < 1e-3 for each in found)


def test_hits_and_misses_that_a_depth_parts_give_finite_figures():
    depths = np.geomspace(2e-5, 1e-3, 40)
    each = detection(depths, np.full(40, 0.03), (depths > 1e-4).astype(float))
    assert 1e-4 < each.a90 < 1.6e-4 < each.a90_95 < 3e-4
    assert each.probability(np.array([each.a90]), 0.03)[0] == pytest.approx(0.9)


def test_what_cannot_be_told_is_not_a_number():
    depths = np.geomspace(2e-5, 1e-3, 40)
    for hits in (np.ones(40), np.zeros(40)):
        assert np.isnan(detection(depths, np.full(40, 0.03), hits).a90)
    assert np.isnan(detection(depths[:5], np.full(5, 0.03), np.array([0, 1, 0, 1, 1.0])).a90)


def test_no_false_call_on_ten_square_metres_is_at_most_a_third_a_metre():
    assert most_calls(0, 10.0) == pytest.approx(0.2996, abs=1e-4)
    assert most_calls(3, 10.0) == pytest.approx(0.7754, abs=1e-4)


def test_the_sentence_says_what_it_holds_for():
    trials = []
    for skin, limit in (('clean', 6e-5), ('dirty', 1.2e-4)):
        depths = np.geomspace(2e-5, 1e-3, 60)
        dents = [[depth, 0.03, int(depth > limit), float(depth)] for depth in depths]
        trials.append(Trial(0.8, skin, 0.2, dents, 0, 0))
    trials.append(Trial(0.8, 'rivets', 5.0, [], 1, 2))
    rows, blanks = rows_of(trials), blanks_of(trials)
    words = sentence(rows, blanks, 5e-5)
    assert 'simulation' in words and '0.8 m' in words and '30 mm' in words
    assert '1 false calls on 5 m²' in words
    assert sentence(rows_of(trials[2:]), blanks, 5e-5).startswith('These 0 dents are too few')


def test_photographs_become_a_page(tmp_path, capsys):
    words = ['evaluate', '--pod', '--output', str(tmp_path), '--blanks', '1', '--dents', '4']
    assert main(words) == 0
    page = (tmp_path / 'detection.html').read_text()
    record = json.loads((tmp_path / 'detection.json').read_text())
    assert record['sentence'] in capsys.readouterr().out
    assert sum(row['detection']['dents'] for row in record['rows']) == 4
    assert 'MIL-HDBK-1823A' in page and 'data:image/png' in page
