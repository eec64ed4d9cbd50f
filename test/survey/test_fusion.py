"""What several clouds tell together: errors fall and say so, and what disagrees is left alone."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from flown_skin import NOISE, FlownSkin
from scipy.spatial.transform import Rotation

from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.fusion import Fusion
from ftp_dent_ros.survey.unrolled import Unrolled

SKIN = Unrolled(
    np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), np.inf
)
LOW, HIGH = np.array([-0.4, -0.3]), np.array([0.6, 0.3])
# Where clouds are in doubt, and how much: metres.
PLACE, DOUBT = np.array([0.09, 0.01]), 1e-4


def clouds_of(skin, count=9):
    """Clouds of a pass, in doubt about one place of the skin; their errors there are their own."""
    clouds = []
    for index, pose in enumerate(skin.flight(count, step=0.02)):
        cloud, _ = skin.seen(pose, index)
        rng = np.random.default_rng([skin.seed, index, 9])
        apart = np.linalg.norm(pose.apply(cloud.points)[..., :2] - PLACE, axis=-1)
        near = np.exp(-np.square(apart / 0.02))
        noise = cv2.GaussianBlur(rng.normal(size=near.shape), (0, 0), 1.2)
        noise *= DOUBT / noise.std() * near
        rays = cloud.points / cloud.points[..., 2:]
        sigma = np.hypot(cloud.sigma, DOUBT * near).astype(np.float32)
        points = (cloud.points + noise[..., None] * rays).astype(np.float32)
        clouds.append((pose, replace(cloud, points=points, sigma=sigma)))
    return clouds


def fusion_of(clouds):
    """All of the clouds, in their places."""
    fusion = Fusion(SKIN, LOW, HIGH)
    for pose, cloud in clouds:
        fusion.add(cloud, pose)
    return fusion


def errors(skin, pose, cloud):
    """Heights against the truth, in standard deviations, where no rim is near."""
    points = pose.apply(cloud.points.astype(float))
    off = points[..., 2] - skin.height(points[..., 0], points[..., 1])
    return (off / cloud.sigma)[10:-10, 10:-10]


@pytest.mark.parametrize('seed', [3, 4])
def test_errors_fall_as_the_uncertainty_says(seed):
    skin = FlownSkin(seed)
    clouds = clouds_of(skin)
    fusion = fusion_of(clouds)
    pose, cloud = clouds[4]
    fused = fusion.fused(cloud, pose)
    assert np.median(fused.sigma) < NOISE / 2
    assert fused.sigma.max() < DOUBT / 2
    assert 0.5 < np.sqrt(np.mean(errors(skin, pose, fused) ** 2)) < 1.2


@pytest.mark.parametrize('seed', [5, 9])
def test_a_dent_that_few_clouds_are_sure_of_is_found_together_and_none_without_it(seed):
    clouds = clouds_of(FlownSkin(seed, dents=((*PLACE, 0.03, 1.4e-4),)))
    fusion = fusion_of(clouds)
    assert sum(bool(inspect(cloud).dents) for _, cloud in clouds) < len(clouds) / 2
    for pose, cloud in clouds:
        (dent,) = inspect(fusion.fused(cloud, pose)).dents
        place = pose.apply(dent.position)
        assert np.linalg.norm(place[:2] - PLACE) < 0.003
        # What all clouds may share does not average out of the depth.
        shared = fusion.shared(place)
        assert shared == pytest.approx(DOUBT, rel=0.1)
        assert abs(dent.depth.value - 1.4e-4) < 2 * np.hypot(dent.depth.uncertainty, shared)
    assert fusion.shared(np.array([-0.35, 0.0, 0.0])) == 0.0

    blank = clouds_of(FlownSkin(seed))
    found = inspect(fusion_of(blank).fused(blank[4][1], blank[4][0]))
    assert not found.dents and not found.others


def test_clouds_that_disagree_are_left_as_they_are():
    skin = FlownSkin(7, dents=((*PLACE, 0.03, 8e-4),))
    poses = list(skin.flight(2, step=0.02))
    clouds = [skin.seen(pose, index)[0] for index, pose in enumerate(poses)]
    # The second lies a centimetre beside its place.
    astray = Pose(Rotation.identity(), np.array([0.01, 0.0, 0.0])) @ poses[1]
    fusion = fusion_of([(poses[0], clouds[0]), (astray, clouds[1])])
    fused = fusion.fused(clouds[0], poses[0])
    moved = np.linalg.norm(fused.points - clouds[0].points, axis=-1)
    places = poses[0].apply(clouds[0].points)[..., :2]
    within = np.linalg.norm(places - PLACE - [0.005, 0], axis=-1) < 0.015
    assert moved[within].max() == 0.0
    (dent,) = inspect(fused).dents
    assert dent.depth.value == pytest.approx(8e-4, rel=0.03)
