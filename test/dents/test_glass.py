"""Marks on a glass keep their place in the picture, dents move through it."""

from __future__ import annotations

import numpy as np
import pytest
from dent_samples import make_dent, scattered
from scipy.spatial.transform import Rotation

from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.dents.glass import Glass
from ftp_dent_ros.dents.kept_list import KeptList
from ftp_dent_ros.pose import Pose

AWAY, VIEW = 0.8, np.array([0.25, 0.16])
COVARIANCE = np.diag([0.03**2] * 3 + [0.015**2] * 3)
# In the picture, as x and y over z: inward and outward beside each other, as drops show.
MARKS = ((0.10, 0.05, 1.2e-3), (0.16, 0.05, -0.9e-3), (-0.2, -0.1, 0.5e-3))
TURNED = Pose(Rotation.from_euler('x', np.pi), np.zeros(3))


def skin_of(rng, count):
    """Places, depths and lengths of dents of 3 m by 0.5 m of skin, no two near each other."""
    places = scattered(rng, count, (-0.4, -0.25), (2.8, 0.25), 0.05)
    return places, rng.uniform(2e-4, 2e-3, count), rng.uniform(0.015, 0.05, count)


def flown(seed, along, marks=(), count=60):
    """What each cloud of a flight shows, at its camera's stated pose, which errs as it wanders."""
    rng = np.random.default_rng(seed)
    places, depths, lengths = skin_of(rng, count)
    error = 0.02 * rng.normal(size=2)
    for x in along:
        error = 0.9 * error + np.sqrt(1 - 0.81) * 0.02 * rng.normal(size=2)
        true = Pose(TURNED.rotation, np.array([x, 0.0, AWAY]))
        stated = Pose(true.rotation, true.translation + np.array([*error, 0.0]))
        shown = [
            (true.inverse().apply(np.array([*place, 0.0])), depth, length)
            for place, depth, length in zip(places, depths, lengths, strict=True)
            if (np.abs(place - [x, 0]) < VIEW).all()
        ]
        shown += [
            (AWAY * np.array([u + 1e-3 * rng.normal(), v + 1e-3 * rng.normal(), 1]), depth, 0.03)
            for u, v, depth in marks
        ]
        dents = [
            make_dent(
                stated.apply(place),
                depth=depth,
                length=length,
                width=0.8 * length,
                normal=(0, 0, 1.0),
                kind='dent' if depth > 0 else 'bump',
            )
            for place, depth, length in shown
        ]
        yield stated, dents


def list_of(frames):
    dents = DentList()
    for number, (pose, shown) in enumerate(frames):
        dents.add(number, shown, pose, COVARIANCE, stamp_ns=number)
    return dents


def glass_of(frames):
    glass = Glass()
    for number, (pose, shown) in enumerate(frames):
        glass = glass.with_frame(number, shown, pose, COVARIANCE)
    return glass


def test_marks_are_told_and_not_listed_and_the_dents_are():
    along = np.arange(0, 1.8, 0.1)
    clean, marked = (list_of(flown(0, along, marks, 25)) for marks in ((), MARKS))
    assert not clean.glass
    assert sorted(np.round(mark.bearing, 2).tolist() for mark in marked.glass) == [
        [-0.2, -0.1],
        [0.1, 0.05],
        [0.16, 0.05],
    ]
    assert len(marked.entries) == len(clean.entries)
    apart = [
        min(np.linalg.norm(each.dent.position - other.dent.position) for other in clean.entries)
        for each in marked.entries
    ]
    # As far as the autopilot may err in the mean of a group.
    assert max(apart) < 0.06


def test_what_is_seen_through_a_mark_alone_is_not_listed():
    """A drop bends what is behind it: now a dent, now half of one, here or there inside it."""
    frames, added = [], (4, 13)
    for number, (pose, shown) in enumerate(flown(0, np.arange(0, 1.8, 0.1), MARKS, 25)):
        if number in added:
            # Beyond what strays, within half the mark's length.
            place = pose.apply(AWAY * np.array([0.10, 0.065, 1]))
            beside = pose.apply(AWAY * np.array([0.10, -0.05, 1]))
            more = [
                make_dent(each, depth=8e-4, length=0.012, width=0.01, normal=(0, 0, 1.0))
                for each in (place, beside)
            ]
            shown = [*shown, *more]
        frames.append((pose, shown))
    clean, marked = list_of(flown(0, np.arange(0, 1.8, 0.1), MARKS, 25)), list_of(frames)
    # Each beside it is a dent as any other.
    assert len(marked.entries) == len(clean.entries) + len(added)


def test_a_drone_that_hovers_decides_nothing():
    assert not glass_of(flown(0, np.full(60, 1.0), MARKS)).marks


@pytest.mark.parametrize('seed', range(2))
def test_no_flight_over_many_dents_tells_of_a_glass(seed):
    there_and_back = np.concatenate([np.arange(0, 2.4, 0.05), np.arange(2.4, 0, -0.05)])
    assert not glass_of(flown(seed, there_and_back, count=200)).marks


def test_a_kept_list_that_is_corrected_and_read_again_leaves_marks_out(tmp_path):
    frames = list(flown(9, np.arange(0, 1.8, 0.1), MARKS, 25))
    kept = KeptList(tmp_path / 'list')
    for number, (pose, shown) in enumerate(frames):
        kept.add('map', number, shown, pose, COVARIANCE)
    before = {each.number: each.dent.position for each in kept.entries}
    aside = Pose(Rotation.identity(), np.array([0.02, 0.0, 0.0]))
    assert kept.correct('map', {n: aside @ pose for n, (pose, _) in enumerate(frames)})
    after = {each.number: each.dent.position for each in kept.entries}
    assert len(kept.snapshot().glass) == len(MARKS) and before.keys() == after.keys()
    assert all(np.allclose(after[n] - before[n], [0.02, 0, 0], atol=1e-3) for n in before)
    again = KeptList(tmp_path / 'list')
    assert len(again.snapshot().glass) == len(MARKS)
    assert {each.number for each in again.entries} == before.keys()
