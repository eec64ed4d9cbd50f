"""Limits, estimates and the smallest dent: what is decided, and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from dent_samples import make_dent

from ftp_dent_ros.dents.dent import Estimate, SmallestDent
from ftp_dent_ros.dents.rules import Limit, Rules, read_rules, verdict
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find


def judged(dent, *limits, among=()):
    return verdict(Rules('', '', limits).judge([dent, *among])[0])


@pytest.mark.parametrize(
    ('depth', 'expected'),
    [
        (1.0e-3, 'within'),
        (1.980e-3, 'within'),
        (1.981e-3, 'cannot decide'),
        (2.0e-3, 'cannot decide'),
        (2.019e-3, 'cannot decide'),
        (2.020e-3, 'exceeds'),
        (float('nan'), 'cannot decide'),
    ],
)
def test_a_limit_is_kept_or_exceeded_only_with_the_whole_95_percent_interval(depth, expected):
    dent = make_dent(depth=depth, sigma=10e-6)
    assert judged(dent, Limit('depth_mm', maximum=2.0)) == expected


def test_a_minimum_of_width_to_depth_counts_both_uncertainties():
    dent = make_dent(depth=1e-3, width=30e-3, sigma=1e-6)
    assert judged(dent, Limit('width_to_depth', minimum=29)) == 'within'
    assert judged(dent, Limit('width_to_depth', minimum=31)) == 'exceeds'
    vague = replace(dent, width=Estimate(30e-3, 1e-3))
    assert judged(vague, Limit('width_to_depth', minimum=29)) == 'cannot decide'
    shallow = replace(dent, depth=Estimate(1e-3, 30e-6))
    assert judged(shallow, Limit('width_to_depth', minimum=29)) == 'cannot decide'


def test_a_cut_dent_can_exceed_but_never_be_within():
    dent = make_dent(depth=1e-3, is_cut=True)
    assert judged(dent, Limit('depth_mm', maximum=0.5)) == 'exceeds'
    assert judged(dent, Limit('depth_mm', maximum=5)) == 'cannot decide'
    assert judged(dent, Limit('width_to_depth', minimum=500)) == 'cannot decide'


def test_a_dent_without_a_neighbour_keeps_every_clearance():
    limit = Limit('clearance_mm', minimum=50)
    assert judged(make_dent(), limit) == 'within'
    assert judged(replace(make_dent(), clearance=0.02), limit) == 'exceeds'


def test_dents_are_counted_in_the_worst_circle_of_the_area():
    # A circle of 0.1 m radius that is centred on none of them takes all three.
    angles = np.radians([90, 210, 330])
    places = 0.095 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    dents = [make_dent(position=place) for place in places]
    limit = Limit('dents_per_area', maximum=2, area_m2=np.pi * 0.1**2)
    findings = Rules('', '', (limit,)).judge(dents)
    assert [found[0].value for found in findings] == [3, 3, 3]
    assert verdict(findings[0]) == 'exceeds'
    apart = [make_dent(position=1.1 * place) for place in places]
    assert [found[0].value for found in Rules('', '', (limit,)).judge(apart)] == [2, 2, 2]
    assert judged(make_dent(), limit) == 'within'


def test_the_shipped_example_is_readable_and_says_that_it_is_fictitious():
    rules = read_rules(find('shipped:example_rules.yaml'))
    assert 'FICTITIOUS' in rules.title
    assert all('fictitious' in limit.reference for limit in rules.limits)
    assert {limit.measure for limit in rules.limits} >= {'depth_mm', 'dents_per_area'}


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'limits': []}, 'limits is []'),
        ({'limits': [3]}, 'limits[0] is no mapping'),
        ({'title': 5}, 'title is 5'),
        ({'limits': [{'measure': 'depth', 'maximum': 1}]}, "limits[0].measure is 'depth'"),
        ({'limits': [{'measure': 'depth_mm'}]}, 'limits[0].measure has neither'),
        ({'limits': [{'measure': 'depth_mm', 'maximum': float('nan')}]}, 'maximum is nan'),
        ({'limits': [{'measure': 'depth_mm', 'maximum': 1, 'minimum': 2}]}, 'above its maximum'),
        ({'limits': [{'measure': 'depth_mm', 'maximum': 1, 'max': 2}]}, 'limits[0].max is un'),
        ({'limits': [{'measure': 'dents_per_area', 'maximum': 1}]}, 'limits[0].area_m2 is 0'),
        ({'limits': [{'measure': 'depth_mm', 'maximum': 1, 'area_m2': 1}]}, 'area_m2 is 1'),
        ({'limits': [{'measure': 'depth_mm', 'maximum': 1, 'reference': 4}]}, 'reference is 4'),
    ],
)
def test_each_malformed_field_is_named_in_one_sentence(tmp_path, change, words):
    path = tmp_path / 'rules.yaml'
    good = {'title': 't', 'limits': [{'measure': 'depth_mm', 'maximum': 1.0}]}
    path.write_text(yaml.safe_dump(good | change))
    with pytest.raises(ConfigurationError) as error:
        read_rules(path)
    assert words in str(error.value)
    assert str(error.value).startswith(f'{path}: ') and '\n' not in str(error.value)


def test_a_value_that_nothing_bounds_is_not_measured():
    for uncertainty in (math.nan, math.inf, -1e-6):
        estimate = Estimate(3.342e-3, uncertainty)
        assert not estimate.is_measured and math.isnan(estimate.value)
    # A bound may be zero, and the next dent nowhere.
    assert Estimate(-1e-3, 0.0).is_measured and Estimate(math.inf, 1e-3).is_measured


@pytest.mark.parametrize('value', [0, 5.0, math.nan, '0.1'])
@pytest.mark.parametrize('name', ['smallest_depth', 'smallest_width'])
def test_what_is_no_length_is_refused(name, value):
    with pytest.raises(ConfigurationError, match=name):
        SmallestDent(**{name: value})
