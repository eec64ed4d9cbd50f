"""What all clouds of a rig have wrong, and what that does to what pairs tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flown_skin import FlownSkin
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import twist_between
from ftp_dent_ros.survey.information import COMMON, RelativePose
from ftp_dent_ros.survey.patch import patch_of
from ftp_dent_ros.survey.pose_graph import PoseGraph
from ftp_dent_ros.survey.pose_terms import Node
from ftp_dent_ros.survey.registration import register

DOUBT = np.diag([3e-4**2] * 6)


def wrong(cloud, errors):
    """A cloud with the six errors, along its own patch's axes."""
    frame = patch_of(cloud).frame
    x, y, z = np.moveaxis(frame.inverse().apply(cloud.points.reshape(-1, 3)), -1, 0)
    bend = errors[0] * x * x + 2 * errors[1] * x * y + errors[2] * y * y
    along = x + errors[3] * x + errors[4] * y, y + errors[4] * x + errors[5] * y
    points = frame.apply(np.stack([*along, z + bend], axis=-1))
    return replace(cloud, points=points.reshape(cloud.points.shape).astype(np.float32))


@pytest.mark.parametrize('turned', [0.0, np.pi])
@pytest.mark.parametrize('index', range(6))
def test_a_pair_errs_as_is_told_by_what_both_clouds_have_wrong(index, turned):
    skin = FlownSkin(5)
    poses = [*skin.flight(1), *skin.flight(1, start=0.07, y=0.07)]
    poses[1] = poses[1] @ Pose(Rotation.from_rotvec([0, 0, turned]), np.zeros(3))
    seen = [skin.seen(pose, number) for number, pose in enumerate(poses)]
    true = poses[0].inverse() @ poses[1]
    # Far more than what the marks' places are off by themselves.
    errors = [50, 50, 50, 300, 300, 300] * np.sqrt(np.diag(COMMON)) * (np.arange(6) == index)
    twists = []
    for wrongly in (0 * errors, errors):
        found = register(*(patch_of(wrong(c, wrongly), k) for c, k in seen), true, DOUBT)
        assert found.told == 6
        twists.append(-twist_between(found.pose, true, found.centre))
    changed, told = twists[1] - twists[0], found.common @ errors
    # The marks are looked up in other places, so that their noise is another one.
    noise = np.sqrt(np.diag(np.linalg.inv(found.information)))
    # A stretched cylinder has another radius: only its shift is as on a plane.
    asked = slice(0, 2) if index >= 3 else slice(None)
    assert (np.abs(changed - told) < 5 * noise)[asked].all()
    assert (np.abs(told) / noise).max() > 7, 'and that is more than noise'


def test_a_long_pass_is_no_straighter_than_its_rig_is_known():
    information = np.linalg.inv(np.diag([1e-6**2] * 3 + [1e-6**2] * 3))
    common = np.zeros((6, 6))
    step = 0.05
    common[0, 3], common[4, 0] = step, -2 * step
    graph, said = PoseGraph(), np.diag([0.03**2] * 3 + [0.015**2] * 3)
    for number in range(101):
        pose = Pose(Rotation.identity(), np.array([step * number, 0, 0]))
        graph.add(Node(pose, said, 0.5 * number, 0), pose)
        if number:
            moved = Pose(Rotation.identity(), np.array([step, 0, 0]))
            told = RelativePose(moved, np.zeros(3), information, 6, 0.8, 1e-6, '', common)
            graph.link(number - 1, number, told)
    spread = np.sqrt(np.diagonal(graph.covariances(anchor=0)[-1]))
    length = 100 * step
    bend, stretch = np.sqrt(COMMON[0, 0]), np.sqrt(COMMON[3, 3])
    assert spread[0] == pytest.approx(stretch * length, rel=0.1)
    assert spread[4] == pytest.approx(2 * bend * length, rel=0.1)
    assert spread[2] == pytest.approx(bend * length**2, rel=0.1)


def test_what_is_common_is_not_taken_for_known_where_pairs_contradict_each_other_by_it():
    information = np.linalg.inv(np.diag([5e-7**2] * 6))
    spread, graph = np.sqrt(COMMON[3, 3]), PoseGraph()
    for number in range(21):
        pose = Pose(Rotation.identity(), np.array([0.05 * number, 0, 0]))
        graph.add(Node(pose, DOUBT, 0.5 * number, 0), pose)
        for back, stretched in ((1, 0.05), (2, 0.0)):
            if number < back:
                continue
            # Only pairs of neighbours are off, by what a stretch of one deviation does.
            common = np.zeros((6, 6))
            common[0, 3] = stretched
            moved = Pose(Rotation.identity(), np.array([0.05 * back - stretched * spread, 0, 0]))
            told = RelativePose(moved, np.zeros(3), information, 6, 0.8, 1e-6, '', common)
            graph.link(number - back, number, told)
    graph.solve()
    off = graph.poses[0].inverse().apply(graph.poses[-1].translation)[0] - 1.0
    stated = np.sqrt(graph.covariances(anchor=0)[-1, 0, 0])
    noise = 5e-7 * np.sqrt(20)
    assert abs(off) > 2 * noise, 'more than what the pairs err by on their own'
    assert abs(off) - noise < stated < abs(off) + noise
