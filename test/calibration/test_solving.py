from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from boards import random_pose, true_correspondences

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import Model, depth_deviation, depths, rig_vector
from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.calibration.page import write_page
from ftp_dent_ros.calibration.solving import STEPS, solve
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig, write_rig

BOARD = Board(7, 6, 0.035)
NOISE = 0.03, 0.02
SIZE = 1280, 720


def observe(rig, count=9, seed=3, board=BOARD):
    rng = np.random.default_rng(seed)
    seen = []
    for index in range(count):
        pose = random_pose(board, rig, rng.choice([0.65, 0.8, 0.95]), rng)
        camera, projector = true_correspondences(board, rig, pose)
        seen.append(
            Observation(
                f'pose_{index}',
                camera + rng.normal(0, NOISE[0], camera.shape),
                projector + rng.normal(0, NOISE[1], projector.shape),
            )
        )
    return seen


@pytest.fixture(scope='module')
def observations(rig):
    return observe(rig)


@pytest.fixture(scope='module')
def solution(observations):
    steps = []
    found = solve(observations, BOARD, SIZE, SIZE, progress=lambda: steps.append(1))
    assert len(steps) <= STEPS
    return found


def test_a_rig_is_found_again(rig, solution):
    assert not solution.model.bent
    camera, projector, _ = solution.estimate.rms()
    # Six numbers a pose and the rig's own take a part of the noise.
    assert 0.8 < camera / (np.sqrt(2) * NOISE[0]) < 1.0
    assert 0.8 < projector / (np.sqrt(2) * NOISE[1]) < 1.0
    deviations = np.sqrt(np.diag(solution.rig.record.covariance))
    estimated = deviations > 0
    off = np.abs(rig_vector(solution.rig) - rig_vector(rig))[estimated] / deviations[estimated]
    assert off.max() < 4
    assert abs(solution.rig.camera.camera_matrix[0, 0] / 1702.4 - 1) < 5e-4
    assert np.linalg.norm(solution.rig.translation - rig.translation) < 1e-4
    assert solution.held_out.rms[2] < 0.06
    assert not solution.excluded


def test_depths_lie_within_their_stated_intervals(rig, solution):
    u, v = np.meshgrid(np.linspace(100, 1180, 7), np.linspace(60, 660, 5))
    pixels = np.tile(np.stack([u.ravel(), v.ravel()], axis=1), (3, 1))
    distance = np.repeat([0.6, 0.8, 1.0], u.size)
    points = rig.camera.rays(pixels) * distance[:, None]
    column = rig.projector.project(rig.to_projector(points))[:, 0]
    np.testing.assert_allclose(depths(rig, pixels, column), distance, atol=1e-9)
    off = depths(solution.rig, pixels, column) - distance
    deviation = depth_deviation(solution.rig, solution.rig.record.covariance, pixels, distance)
    assert np.sqrt(np.mean(np.square(off / deviation))) < 2
    assert np.median(deviation) < 2e-4


def test_rig_and_page_are_written(tmp_path, solution):
    write_rig(tmp_path / 'rig.yaml', solution.rig)
    read = read_rig(tmp_path / 'rig.yaml')
    assert read.id == solution.rig.id == read.record.id
    assert read.record.poses == 9
    np.testing.assert_allclose(
        read.record.covariance, solution.rig.record.covariance, rtol=1e-6, atol=1e-15
    )
    write_page(tmp_path / 'rig.html', solution, ['pose_9: blurred'])
    page = (tmp_path / 'rig.html').read_text()
    for words in (solution.rig.id, 'held out', 'pose_9: blurred', 'baseline, mm'):
        assert words in page
    assert page.count('data:image/png') == 3


def test_what_few_poses_leave_open_is_refused_with_what_to_photograph_next(rig):
    """Three boards of one tilt: the focal lengths come out with hundreds of pixels' deviation."""
    pose = Pose.from_rpy((0.03, 0.02, 0.0), (-0.1, -0.08, 0.8))
    rng = np.random.default_rng(1)
    seen = []
    for shift in range(3):
        moved = Pose(pose.rotation, pose.translation + 0.01 * shift * np.array([2, 1, 1]))
        camera, projector = true_correspondences(BOARD, rig, moved)
        noise = rng.normal(0, 0.05, (2, *camera.shape))
        seen.append(Observation(f'pose_{shift}', camera + noise[0], projector + noise[1]))
    with pytest.raises(CalibrationError, match=r'leave the rig open \(.*photograph more poses'):
        solve(seen, BOARD, SIZE, SIZE)


def test_mistakes_are_named(observations):
    def refused(seen, **options):
        with pytest.raises(CalibrationError) as reason:
            solve(seen, options.pop('board', BOARD), SIZE, SIZE, **options)
        return str(reason.value)

    swapped = [replace(o, projector=o.projector[:, ::-1]) for o in observations]
    assert 'rows and columns are exchanged' in refused(swapped)
    mirrored = [
        replace(o, projector=np.column_stack([1279 - o.projector[:, 0], o.projector[:, 1]]))
        for o in observations
    ]
    assert 'image is mirrored' in refused(mirrored)
    grid = np.arange(42).reshape(6, 7)[:, ::-1].ravel()
    turned = [replace(o, camera=o.camera[grid], projector=o.projector[grid]) for o in observations]
    assert 'as in a mirror' in refused(turned)
    exchanged = [replace(o, camera=o.camera[:, ::-1]) for o in observations]
    assert 'exchanged' in refused(exchanged)
    wrong = Board(7, 6, 0.030)
    assert 'a square is 1.1' in refused(observations, board=wrong, baseline=0.247)
    assert 'fewer than 3' in refused(observations[:2])


def test_a_pose_in_which_the_board_moved_is_left_out(observations):
    moved = replace(observations[4], projector=observations[4].projector * [1.02, 0.97])
    found = solve(
        [*observations[:4], moved, *observations[5:]], BOARD, SIZE, SIZE, model=Model(3, 3)
    )
    assert list(found.excluded) == ['pose_4']
    assert 'moved' in found.excluded['pose_4']
    assert found.estimate.rms()[2] < 0.06


def test_half_of_the_coordinates_missing_is_survived(rig, observations):
    rng = np.random.default_rng(0)
    holes = []
    for index, each in enumerate(observations):
        projector = each.projector.copy()
        if index % 3 == 0:
            projector[:, 1] = np.nan
        elif index % 3 == 1:
            projector[:] = np.nan
        projector[rng.random(42) < 0.2] = np.nan
        holes.append(replace(each, projector=projector))
    found = solve(holes, BOARD, SIZE, SIZE, model=Model(3, 3))
    assert np.linalg.norm(found.rig.translation - rig.translation) < 1e-3
