import time
from dataclasses import replace

import numpy as np
import pytest
from dent_samples import make_dent

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.dents.kept_list import KeptList
from ftp_dent_ros.dents.sightings import coincidence, combined
from ftp_dent_ros.pose import Pose

POSE = Pose.from_rpy((0, 0, 0), (0, 0, 0))
KNOWN = np.diag([1e-5] * 3 + [1e-8] * 3)


def listed(*frames, covariance=KNOWN):
    dents = DentList()
    for number, frame in enumerate(frames, start=1):
        dents.add(number, frame, POSE, covariance)
    return dents


def test_a_dent_that_is_seen_again_stays_one_dent_whose_scatter_averages_out():
    sigma = 10e-6
    frames = [
        [make_dent((0.1 + shift, 0, 0.6), 2e-3 + shift / 1e3, sigma=sigma)]
        for shift in (-3e-3, 0.0, 3e-3)
    ]
    (entry,) = listed(*frames).entries
    assert len(entry.sightings) == 3
    np.testing.assert_allclose(entry.dent.position, [0.1, 0, 0.6], atol=1e-9)
    assert entry.dent.depth.value == pytest.approx(2e-3, abs=1e-9)
    scatter = 3e-6
    common = sigma**2 - scatter**2
    assert entry.dent.depth.uncertainty == pytest.approx(np.sqrt(common + scatter**2 / 3))
    assert np.allclose(entry.position_covariance, np.eye(3) * entry.position_covariance[0, 0])
    # What the poses of a flight have in common does not average out.
    assert entry.position_covariance[0, 0] == pytest.approx(KNOWN[0, 0], rel=0.01)


def test_neighbours_stay_apart_and_each_keeps_its_own_sightings():
    a, b = (0.0, 0.0, 0.6), (0.05, 0.0, 0.6)
    frames = [
        [make_dent(np.add(a, shift), length=20e-3), make_dent(np.add(b, shift), length=20e-3)]
        for shift in (0.0, 4e-3, -4e-3)
    ]
    # The order in a frame does not matter.
    frames[1].reverse()
    entries = listed(*frames).entries
    assert [len(entry.sightings) for entry in entries] == [3, 3]
    np.testing.assert_allclose([e.dent.position for e in entries], [a, b], atol=2e-3)
    assert entries[0].dent.clearance == pytest.approx(0.03, abs=4e-3)
    assert entries[0].dent.clearance == entries[1].dent.clearance


def test_a_dent_that_one_frame_cuts_is_measured_where_it_is_whole():
    whole = make_dent((0, 0, 0.6), depth=2e-3, length=60e-3)
    cut = make_dent((0.02, 0, 0.6), depth=1.1e-3, length=25e-3, is_cut=True)
    (entry,) = listed([cut], [whole], [cut]).entries
    assert (len(entry.sightings), entry.best, entry.dent.is_cut) == (3, 2, False)
    assert entry.dent.depth.value == pytest.approx(2e-3)
    np.testing.assert_array_equal(entry.dent.position, whole.position)
    # Nowhere whole, it stays a cut dent with the largest extent.
    shorter = replace(cut, length=Estimate(20e-3, 1e-3))
    (entry,) = listed([shorter], [cut]).entries
    assert entry.dent.is_cut and entry.dent.length.value == pytest.approx(25e-3)


@pytest.mark.parametrize(
    ('measured', 'together'),
    [
        # What they do not show as scatter, they may have in common.
        ([(1.0, 0.1), (1.0, 0.1)], (1.0, 0.1)),
        ([(0.0, 0.1), (2.0, 0.1)], (1.0, 1.0)),
        ([(np.nan, 0.1), (3.0, 0.2)], (3.0, 0.2)),
        ([(np.nan, 0.1)], (np.nan, np.nan)),
    ],
)
def test_measurements_that_disagree_are_as_uncertain_as_they_scatter(measured, together):
    one = combined([Estimate(*each) for each in measured])
    assert (one.value, one.uncertainty) == pytest.approx(together, nan_ok=True)


def test_orientations_on_both_sides_of_the_half_turn_agree():
    near = np.pi / 2 - 0.01
    dents = [
        replace(
            make_dent(axis=(np.cos(near), -sign * np.sin(near), 0.0)),
            orientation=Estimate(sign * near, 0.01),
        )
        for sign in (1, -1)
    ]
    (entry,) = listed(*([dent] for dent in dents)).entries
    assert abs(entry.dent.orientation.value) == pytest.approx(np.pi / 2, abs=1e-9)


def test_parts_that_only_poses_tie_have_one_number_or_say_that_two_may_be_one():
    # As hail: a single dent is among too many that fit it to be sure of.
    rng = np.random.default_rng(5)
    places = [(x, y, 0.6) for x in np.arange(0, 0.3, 0.05) for y in np.arange(0, 0.3, 0.05)]
    hail = [
        make_dent(each, depth, 0.02, 0.018, sigma=3e-5)
        for each, depth in zip(places, rng.uniform(3e-4, 5e-4, len(places)), strict=True)
    ]
    poses = np.diag([0.03**2] * 3 + [1e-8] * 3)
    off = np.array([0.02, -0.015, 0.01])
    seen = replace(hail[14], position=hail[14].position + off)
    alone = listed(hail, [seen], covariance=poses).entries
    last = alone[-1]
    assert len(alone) == len(hail) + 1 and 15 in last.maybe
    assert f'may be the same as number {last.maybe[0]} or ' in last.reason
    assert all(last.number in alone[number - 1].maybe for number in last.maybe)
    # What lies too far away, or is of another size, is no such dent.
    maybe = [hail[number - 1].position for number in last.maybe]
    assert np.linalg.norm(np.subtract(maybe, seen.position), axis=1).max() < 0.03 * 3.75 * 1.5
    elsewhere = replace(seen, position=np.add(seen.position, [2.0, 0, 0]))
    *_, other = listed(hail, [elsewhere], covariance=poses).entries
    assert other.maybe == () and other.reason == ''
    # Several are a constellation, which is one in the list.
    several = [replace(dent, position=dent.position + off) for dent in hail[8:20]]
    together = listed(hail, several, covariance=poses).entries
    assert len(together) == len(hail) and not any(each.maybe for each in together)


def test_one_dent_alone_is_known_again_by_its_sizes():
    unsure = np.diag([0.15**2] * 3 + [0.01**2] * 3)
    first, again = make_dent((0, 0, 0.6), 9e-4), make_dent((0.1, -0.07, 0.6), 9.1e-4)
    (entry,) = listed([first], [again], covariance=unsure).entries
    assert len(entry.sightings) == 2
    other = make_dent((0.1, -0.07, 0.6), 1.8e-3)
    assert len(listed([first], [other], covariance=unsure).entries) == 2
    # What the frame cuts has no size to be known by.
    assert not coincidence([first], [replace(again, is_cut=True)], [again]).any()


def test_a_part_of_what_more_clouds_show_whole_is_no_dent_of_its_own():
    # By which the clouds know where they lie.
    anchor = make_dent((0.2, 0, 0.6), 5e-4, 0.03, 0.02)
    whole = [make_dent((0, 0, 0.6), 1e-3, 0.1, 0.067), anchor]
    left, right, beside = (
        make_dent(place, 0.97e-3, 0.05, 0.05, is_cut=True)
        for place in ((-0.02, 0.004, 0.6), (0.016, 0.004, 0.6), (0.0, 0.06, 0.6))
    )
    parts = [left, right, anchor]
    first, second = listed(whole, whole, parts).entries
    assert first.dent.depth.value == pytest.approx(1e-3) and not first.dent.is_cut
    assert len(second.sightings) == 3
    # Whichever comes first; and beside it, or as often as the whole, it is a dent.
    assert len(listed(parts, whole, whole).entries) == 2
    assert len(listed(whole, whole, [left, beside, anchor]).entries) == 3
    assert len(listed(whole, parts, parts).entries) == 3
    outward = replace(right, depth=Estimate(-1e-3, 1e-5), kind='bump')
    assert len(listed(whole, whole, [left, outward, anchor]).entries) == 3
    # Where no other dent ties the clouds, poses as good as a survey's do.
    alone = [whole[0]], [whole[0]], [left, right]
    assert len(listed(*alone).entries) == 1
    assert len(listed(*alone, covariance=100 * KNOWN).entries) == 2


def test_a_cloud_costs_no_more_the_longer_the_list_is():
    rng, covariance = np.random.default_rng(8), np.diag([1e-4] * 3 + [1e-5] * 3)
    kept, spent = KeptList(), []
    for number in range(120):
        at = 0.25 * number
        dents = [
            make_dent((at + x, y, 0.0) + rng.normal(0, 5e-3, 3) * [1, 1, 0], normal=(0, 0, 1))
            for x, y in ((0.0, 0.0), (0.1, 0.05), (0.05, 0.15), (0.15, 0.2))
        ]
        camera = Pose.from_rpy((np.pi, 0, 0), (at, 0.1, 0.8))
        started = time.process_time()
        kept.add('map', number, dents, camera, covariance)
        kept.snapshot()
        spent.append(time.process_time() - started)
    assert len(kept.entries) == 480
    # At 2 Hz, with the drawing of the list, a tenth of a core.
    assert 2 * np.median(spent[-20:]) + 1 / 21 < 0.1
