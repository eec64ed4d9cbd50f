"""Flights joined to one skin under an erring autopilot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flown_skin import STATED, FlownSkin, erring
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.joining import Joining

HALF_S = 500_000_000


def joined(skin, poses, stated):
    joining = Joining()
    for index, (pose, said) in enumerate(zip(poses, stated, strict=True)):
        covariance = None if said is None else STATED
        joining.add(index * HALF_S, skin.seen(pose, index), said, covariance)
    joining.finish()
    return joining


def farthest(poses, others):
    pairs = zip(poses, others, strict=True)
    return max(np.linalg.norm(a.translation - b.translation) for a, b in pairs)


def relative_errors(graph, poses):
    """Of each pose seen from the first: millimetres."""
    first, true = graph.poses[0].inverse(), poses[0].inverse()
    return np.array(
        [
            1e3 * np.linalg.norm((first @ a).translation - (true @ b).translation)
            for a, b in zip(graph.poses, poses, strict=True)
        ]
    )


@pytest.fixture(scope='module')
def strip():
    skin = FlownSkin(11)
    poses = list(skin.flight(6))
    return poses, joined(skin, poses, erring(poses, 11))


def test_clouds_agree_with_each_other_though_the_autopilot_does_not(strip):
    poses, joining = strip
    stated = [node.stated for node in joining.graph.nodes]
    assert farthest(stated, poses) > 0.02
    assert relative_errors(joining.graph, poses).max() < 0.6
    assert not joining.graph.left_out and len(set(joining.graph.groups())) == 1


def test_what_is_stated_of_poses_holds(strip):
    poses, joining = strip
    errors = []
    for found, true in zip(joining.graph.poses, poses, strict=True):
        turn = (found.rotation * true.rotation.inv()).as_rotvec()
        errors.append(np.concatenate([found.translation - true.translation, turn]))
    covariances = joining.graph.covariances()
    misfits = [e @ np.linalg.solve(c, e) / 6 for e, c in zip(errors, covariances, strict=True)]
    assert np.mean(misfits) < 4
    # The map is known no better than by the autopilot.
    assert np.sqrt(covariances[0, 0, 0]) > 0.005


def test_a_pair_that_contradicts_the_others_is_left_out_and_told(strip):
    _, joining = strip
    before = list(joining.graph.poses)
    graph = joining.graph
    forced = next(link for link in graph.links if (link.first, link.second) == (3, 4))
    wrong = Pose(Rotation.identity(), np.array([0.025, 0, 0])) @ forced.relative.pose
    kept = list(graph.links)
    graph.links[graph.links.index(forced)] = replace(
        forced, relative=replace(forced.relative, pose=wrong)
    )
    joining.finish()
    assert len(graph.left_out) == 1
    assert any('contradicts the others' in text for text in joining.remarks)
    assert farthest(graph.poses, before) < 5e-4, 'the map is not bent'
    graph.links[:] = kept
    joining.finish()
    assert not graph.left_out


def test_a_second_pass_is_joined_to_the_first():
    skin = FlownSkin(12)
    there = list(skin.flight(4))
    back = list(skin.flight(3, start=0.15, step=-0.05, y=0.1))
    # As far apart in number as passes are.
    middle = list(skin.flight(4, start=0.17, step=0.002, y=0.05))
    poses = [*there, *middle, *back]
    joining = joined(skin, poses, erring(poses, 12))
    assert any(link.second - link.first >= 8 for link in joining.graph.links)
    assert relative_errors(joining.graph, poses).max() < 1.0


def test_passes_are_joined_anew_where_they_show_other_skin():
    skin, joining = FlownSkin(14), Joining()
    for flight, y in enumerate((0.0, 0.1)):
        poses = list(skin.flight(5, y=y))
        for index, (pose, said) in enumerate(zip(poses, erring(poses, flight), strict=True)):
            number = 10 * flight + index
            joining.add(number * HALF_S, skin.seen(pose, number), said, STATED, flight)
    joining.finish()
    closing = [link.second for link in joining.graph.links if link.first < 5 <= link.second]
    # A cloud is 0.22 m across, and 0.05 m from the one before.
    assert len(closing) >= 2 and np.diff(closing).min() >= 2
    assert not joining.graph.left_out and len(set(joining.graph.groups())) == 1


def test_a_bare_part_is_held_by_the_autopilot_and_says_so():
    skin = FlownSkin(13, marked=(-9.0, 0.1))
    poses = list(skin.flight(6, start=-0.1, step=0.1))
    joining = joined(skin, poses, erring(poses, 13))
    near = joining.graph.covariances(anchor=0)
    first = np.sqrt(near[1, 0, 0])
    assert first < 5e-4
    # Along the axis of a bare cylinder nothing but the autopilot tells.
    assert np.sqrt(near[-1, 0, 0]) > 5e-3
    off = relative_errors(joining.graph, poses)[-1] * 1e-3
    assert off < 4 * np.sqrt(np.trace(near[-1, :3, :3]))


def test_without_poses_the_clouds_join_by_themselves():
    skin = FlownSkin(14)
    poses = list(skin.flight(4))
    joining = joined(skin, poses, [None] * 4)
    assert relative_errors(joining.graph, poses).max() < 0.6


def test_flights_are_found_on_each_other_as_far_as_their_poses_state():
    skin, joining, true = FlownSkin(31), Joining(), []
    covariance = np.diag([0.3**2] * 3 + [0.015**2] * 3)
    for flight in range(2):
        poses = list(skin.flight(5, y=0.01 * flight))
        true += poses
        for index, (pose, said) in enumerate(zip(poses, erring(poses, flight), strict=True)):
            off = Pose(said.rotation, said.translation + flight * np.array([0.4, 0.3, 0]))
            number = 1000 * flight + index
            joining.add(number * HALF_S, skin.seen(pose, number), off, covariance, flight)
    joining.finish()
    assert len(joining.parts()) == 1
    assert relative_errors(joining.graph, true).max() < 1.0


def test_other_skin_is_not_taken_for_the_same():
    joining = Joining()
    covariance = np.diag([0.3**2] * 3 + [0.015**2] * 3)
    for flight in range(2):
        skin = FlownSkin(41 + flight)
        poses = list(skin.flight(4))
        for index, pose in enumerate(poses):
            number = 1000 * flight + index
            joining.add(number * HALF_S, skin.seen(pose, number), pose, covariance, flight)
    joining.finish()
    first, second = joining.parts()
    assert len(first.numbers) == len(second.numbers) == 4
    assert list(second.numbers.values()) == [0, 1, 2, 3]


def test_odd_clouds_are_refused_with_a_reason_and_change_nothing():
    skin, joining, rng = FlownSkin(31), Joining(), np.random.default_rng(1)
    poses = list(skin.flight(2))
    good = skin.seen(poses[0], 0)
    far, shape = good.points.copy(), good.points.shape
    far[40, 50] = [5e3, 0, 0.8]
    row = good.points.reshape(1, -1, 3), good.intensity.reshape(1, -1)
    odd = {
        'points far off': replace(good, points=far),
        'correct its unit': replace(good, points=1e3 * good.points),
        'not the grid of a camera': Cloud(*row),
        'it is noise': replace(good, points=rng.normal(size=shape).astype(np.float32)),
        'neighbours': replace(good, points=0 * good.points),
    }
    joining.add(0, good, poses[0], STATED)
    for number, (reason, cloud) in enumerate(odd.items(), start=1):
        with pytest.raises(CloudError, match=reason):
            joining.add(number, cloud, poses[0], STATED)
    joining.add(HALF_S, skin.seen(poses[1], 1), poses[1], STATED)
    joining.finish()
    assert list(joining.numbers) == [0, HALF_S] and len(set(joining.graph.groups())) == 1
