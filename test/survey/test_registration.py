"""Neighbouring clouds laid on each other, against where they truly lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flown_skin import STATED, FlownSkin
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import twist_between
from ftp_dent_ros.survey.patch import SkinPatch, patch_of
from ftp_dent_ros.survey.registration import UnlikePairError, register

DOUBT = STATED / 4


def error_of(found, true):
    return twist_between(found.pose, true, found.centre)


def pair(skin, **flight):
    poses = list(skin.flight(2, **flight))
    patches = [patch_of(skin.seen(pose, index)) for index, pose in enumerate(poses)]
    return patches, poses[0].inverse() @ poses[1]


def unpainted(cloud):
    return replace(cloud, skin=np.zeros_like(cloud.skin))


def off(true, seed):
    error = np.random.default_rng(seed).multivariate_normal(np.zeros(6), DOUBT)
    return Pose(Rotation.from_rotvec(error[3:]) * true.rotation, true.translation + error[:3])


def test_marked_skin_is_found_to_a_tenth_of_a_millimetre_and_says_how_well():
    normalised = []
    for seed in range(3):
        patches, true = pair(FlownSkin(seed))
        found = register(*patches, off(true, seed), DOUBT)
        error = error_of(found, true)
        assert found.rank == 6 and not found.remark
        assert np.abs(error[:2]).max() < 2.5e-4 and abs(error[2]) < 2e-5
        assert np.degrees(np.abs(error[3:])).max() < 0.03
        normalised.append(error @ found.information @ error / 6)
    assert 0.1 < np.sqrt(np.mean(normalised)) < 2


def test_a_side_overlap_holds_what_it_states_and_states_more_than_neighbours_do():
    normalised, stated = [], []
    for seed in range(20, 23):
        skin = FlownSkin(seed)
        poses = [*skin.flight(2), *skin.flight(1, y=0.15)]
        patches = [patch_of(skin.seen(pose, index)) for index, pose in enumerate(poses)]
        spreads = []
        for other in (1, 2):
            true = poses[0].inverse() @ poses[other]
            found = register(patches[0], patches[other], off(true, seed), DOUBT)
            spreads.append(np.sqrt(np.diag(np.linalg.inv(found.information))))
        error = error_of(found, true)
        assert found.rank == 6
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
    assert 3 <= found.rank < 6
    # In some direction nothing is believed at all.
    assert np.linalg.eigvalsh(found.information).min() < 1 / 0.1**2
    error = error_of(found, true)
    # What is believed holds.
    assert error @ found.information @ error < 40


def test_clouds_apart_are_refused():
    skin = FlownSkin(7)
    near, far = skin.seen(next(skin.flight(1)), 0), skin.seen(next(skin.flight(1, start=0.8)), 1)
    guess = Pose(Rotation.identity(), np.array([0.8, 0, 0]))
    with pytest.raises(UnlikePairError, match='do not overlap'):
        register(patch_of(near), patch_of(far), guess, DOUBT)


def test_too_few_points_are_refused():
    points = np.full((20, 20, 3), np.nan, np.float32)
    points[:3] = 0.5
    with pytest.raises(CloudError, match='too few'):
        patch_of(Cloud(points, np.zeros((20, 20), np.float32)))


def test_a_cloud_lies_on_itself_and_on_a_copy():
    skin = FlownSkin(3)
    (pose,) = skin.flight(1)
    patch = patch_of(skin.seen(pose, 0))
    for other in (patch, patch_of(skin.seen(pose, 0))):
        found = register(patch, other, Pose(Rotation.identity(), np.zeros(3)), DOUBT)
        assert found.rank == 6 and np.isfinite(found.information).all()
        assert np.linalg.norm(found.pose.translation) < 1e-6


@pytest.mark.parametrize(('pitch', 'doubt'), [(0.015, 0.035), (0.025, 0.014), (0.038, 0.035)])
def test_a_skin_that_repeats_itself_is_never_tied_a_pitch_off(pitch, doubt):
    covariance = np.diag([doubt**2] * 3 + [(doubt / 3) ** 2] * 3)
    for seed in range(2):
        patches, true = pair(FlownSkin(seed, pitch=pitch))
        for pitches in (-1.6, -0.4, 0.4, 1.4):
            shift = np.array([pitches * pitch, 0.003, 0.004])
            guess = Pose(true.rotation, true.translation + shift)
            found = register(*patches, guess, covariance)
            is_tied = not found.remark
            assert not is_tied or np.abs(error_of(found, true)[:2]).max() < 1e-3
            assert is_tied or ('more places than one' in found.remark and found.rank < 6)


def test_a_good_guess_decides_between_pitches():
    patches, true = pair(FlownSkin(4, pitch=0.025))
    sure = np.diag([0.004**2] * 3 + [0.001**2] * 3)
    guess = Pose(true.rotation, true.translation + np.array([0.004, 0.002, 0]))
    found = register(*patches, guess, sure)
    assert not found.remark and np.abs(error_of(found, true)[:2]).max() < 1e-3


@pytest.mark.xfail(strict=False, reason='0.256 mm along the skin with OpenCV 4.6')
def test_what_does_not_repeat_itself_decides_between_pitches():
    skin = FlownSkin(4, pitch=0.025)
    # Letters, as it were: lines of 2 mm.
    rng = np.random.default_rng(4)
    for x, y in rng.uniform([1350, 300], [1650, 500], (25, 2)).astype(int):
        skin.paint[y : y + 20, x : x + 2] -= 0.2
    patches, true = pair(skin)
    doubt = np.diag([0.014**2] * 3 + [0.005**2] * 3)
    guess = Pose(true.rotation, true.translation + np.array([0.035, 0, 0]))
    found = register(*patches, guess, doubt)
    assert not found.remark and np.abs(error_of(found, true)[:2]).max() < 2.5e-4


def test_a_place_is_looked_for_as_far_as_the_guess_is_doubted():
    patches, true = pair(FlownSkin(1))
    guess = Pose(true.rotation, true.translation + np.array([0.03, 0.0, 0.0]))
    sure = np.diag([0.002**2] * 3 + [0.001**2] * 3)
    assert register(*patches, guess, sure).remark
    found = register(*patches, guess, DOUBT)
    assert not found.remark and np.abs(error_of(found, true)[:2]).max() < 2.5e-4


def test_without_an_image_of_the_skin_a_shape_beside_its_place_is_not_sure_of_itself():
    rng = np.random.default_rng(0)
    covariance = np.diag([0.035**2] * 3 + [0.012**2] * 3)
    misfits = []
    for seed in range(3):
        places = rng.uniform([-0.15, -0.1], [0.2, 0.1], (6, 2))
        skin = FlownSkin(seed, pitch=0.025, dents=tuple((x, y, 0.05, 5e-4) for x, y in places))
        poses = list(skin.flight(2))
        patches = [patch_of(unpainted(skin.seen(pose, index))) for index, pose in enumerate(poses)]
        true = poses[0].inverse() @ poses[1]
        for x in (-0.06, 0.06):
            guess = Pose(true.rotation, true.translation + np.array([x, 0.01, 0.0]))
            found = register(*patches, guess, covariance)
            assert 'without a skin image' in found.remark
            error = error_of(found, true)
            misfits.append(error @ found.information @ error / max(found.rank, 1))
    assert np.sqrt(np.mean(misfits)) < 3


def test_a_skin_is_bent_between_the_cells_of_its_patch():
    """Chords of a fuselage at 3 mm a cell lie 0.4 micrometres in it, and that adds up."""
    x, y = np.meshgrid(np.arange(-0.15, 0.15, 0.003), np.arange(-0.1, 0.1, 0.003))
    height = (-(y**2) / 4 + 0.02 * x).astype(np.float32)
    level = Pose(Rotation.identity(), np.zeros(3))
    patch = SkinPatch(level, 0.003, np.array([x[0, 0], y[0, 0]]), height, np.ones_like(height))
    places = np.random.default_rng(1).uniform(-0.08, 0.08, (500, 3))
    off = patch.below(places)[:, 0] - (-(places[:, 1] ** 2) / 4 + 0.02 * places[:, 0])
    assert abs(off.mean()) < 1e-8 and np.abs(off).max() < 5e-8
