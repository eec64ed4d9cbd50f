"""Neighbouring clouds laid on each other, against where they truly lie."""

from __future__ import annotations

import numpy as np
import pytest
from flown_skin import STATED, FlownSkin
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patches.folded_patch import FoldedPatch
from ftp_dent_ros.survey.patches.patch import patch_of
from ftp_dent_ros.survey.registration.registration import register
from ftp_dent_ros.survey.registration.relative_pose import UnlikePairError

DOUBT = STATED / 4


def pair(skin, **flight):
    poses = list(skin.flight(2, **flight))
    patches = [patch_of(*skin.seen(pose, index)) for index, pose in enumerate(poses)]
    return patches, poses[0].inverse() @ poses[1]


def off(true, seed):
    error = np.random.default_rng(seed).multivariate_normal(np.zeros(6), DOUBT)
    return Pose(Rotation.from_rotvec(error[3:]) * true.rotation, true.translation + error[:3])


def test_marked_skin_is_found_to_a_tenth_of_a_millimetre_and_says_how_well():
    normalised = []
    for seed in range(3):
        patches, true = pair(FlownSkin(seed))
        found = register(*patches, off(true, seed), DOUBT)
        error = found.error(true)
        assert found.told == 6 and not found.remark
        assert np.abs(error[:2]).max() < 2.5e-4 and abs(error[2]) < 2e-5
        assert np.degrees(np.abs(error[3:])).max() < 0.03
        normalised.append(error @ found.information @ error / 6)
    assert 0.1 < np.sqrt(np.mean(normalised)) < 2


def test_a_side_overlap_holds_what_it_states_and_states_more_than_neighbours_do():
    normalised, stated = [], []
    for seed in range(20, 23):
        skin = FlownSkin(seed)
        poses = [*skin.flight(2), *skin.flight(1, y=0.15)]
        patches = [patch_of(*skin.seen(pose, index)) for index, pose in enumerate(poses)]
        spreads = []
        for other in (1, 2):
            true = poses[0].inverse() @ poses[other]
            found = register(patches[0], patches[other], off(true, seed), DOUBT)
            spreads.append(np.sqrt(np.diag(np.linalg.inv(found.information))))
        error = found.error(true)
        assert found.told == 6 and 0.2 < found.overlap < 0.4
        normalised.append(error @ found.information @ error / 6)
        # Relief of a tenth of a millimetre, seen from places 0.15 m apart at 0.8 m.
        assert spreads[1][1] > 1e-4 * 0.15 / 0.8
        stated.append(spreads)
    neighbours, side = np.sqrt(np.mean(np.square(stated), axis=0))
    # The narrow overlap turns about the flight's direction, and slides.
    assert side[3] > 1.5 * neighbours[3] and side[0] > neighbours[0]
    assert 0.1 < np.sqrt(np.mean(normalised)) < 2


def test_bare_skin_tells_its_height_and_tilt_and_no_place_along_it():
    skin = FlownSkin(5, marked=(9.0, 9.0))
    patches, true = pair(skin)
    found = register(*patches, off(true, 1), DOUBT)
    assert 3 <= found.told < 6
    # In some direction nothing is believed at all.
    assert np.linalg.eigvalsh(found.information).min() < 1 / 0.1**2
    error = found.error(true)
    # What is believed holds.
    assert error @ found.information @ error < 40


def test_without_an_image_of_the_skin_the_shape_alone_is_used():
    skin = FlownSkin(6)
    poses = list(skin.flight(2))
    patches = [patch_of(skin.seen(pose, index)[0]) for index, pose in enumerate(poses)]
    true = poses[0].inverse() @ poses[1]
    found = register(*patches, off(true, 2), DOUBT)
    assert found.told < 6 and 'without a skin image' in found.remark


def test_clouds_apart_are_refused():
    skin = FlownSkin(7)
    near, far = skin.seen(next(skin.flight(1)), 0), skin.seen(next(skin.flight(1, start=0.8)), 1)
    guess = Pose(Rotation.identity(), np.array([0.8, 0, 0]))
    with pytest.raises(UnlikePairError, match='do not overlap'):
        register(patch_of(*near), patch_of(*far), guess, DOUBT)


def test_a_patch_holds_what_the_cloud_does():
    skin = FlownSkin(8)
    cloud, image = skin.seen(next(skin.flight(1)), 0)
    patch = patch_of(cloud, image)
    row, column = np.nonzero(patch.known)
    keep = slice(None, None, 37)
    pose = next(skin.flight(1))
    points = pose.apply(patch.frame.apply(patch.points(row[keep], column[keep])))
    height = skin.height(points[:, 0], points[:, 1])
    assert np.abs(points[:, 2] - height).max() < 5e-5
    folded = FoldedPatch.of(patch)
    again = folded.unfolded()
    np.testing.assert_allclose(again.height, patch.height, atol=1e-6)
    np.testing.assert_allclose(again.paint[..., 0], patch.paint[..., 0], atol=0.002)
    np.testing.assert_allclose(again.sigma[patch.known], patch.sigma[patch.known], rtol=0.1)
    held = len(folded.steps) + folded.sigma.nbytes + len(folded.light)
    assert held < 5 * patch.height.size


def test_too_few_points_are_refused():
    points = np.full((20, 20, 3), np.nan, np.float32)
    points[:3] = 0.5
    with pytest.raises(CloudError, match='too few'):
        patch_of(Cloud(points, np.zeros((20, 20), np.float32)))


def test_a_cloud_lies_on_itself_and_on_a_copy():
    skin = FlownSkin(3)
    (pose,) = skin.flight(1)
    patch = patch_of(*skin.seen(pose, 0))
    for other in (patch, patch_of(*skin.seen(pose, 0))):
        found = register(patch, other, Pose(Rotation.identity(), np.zeros(3)), DOUBT)
        assert found.told == 6 and np.isfinite(found.information).all()
        assert np.linalg.norm(found.pose.translation) < 1e-6
