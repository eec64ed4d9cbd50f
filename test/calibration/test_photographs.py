from __future__ import annotations

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from boards import photographs, random_pose, true_correspondences
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import Model
from ftp_dent_ros.calibration.observing import observe
from ftp_dent_ros.calibration.sequence import ProjectedFrame, Sequence
from ftp_dent_ros.calibration.session import (
    Session,
    read_pose,
    read_session,
    see_poses,
    write_session,
)
from ftp_dent_ros.calibration.solving import solve
from ftp_dent_ros.cli.main import main
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.rig.rig import Lens, Rig, read_rig
from ftp_dent_ros.simulation import Photometry

BOARD = Board(7, 6, 0.03)
SEQUENCE = Sequence(400, 300, period=16, steps=5)
GRAY = Sequence(400, 300, period=0)
LIGHT = Photometry(projector_gamma=2.0, defocus_px=1.0, psf_px=0.6, reference_distance=0.7)


@pytest.fixture(scope='module')
def rig():
    camera = Lens(
        640,
        480,
        np.array([[900.0, 0, 322], [0, 901, 236], [0, 0, 1]]),
        np.array([-0.1, 0.05, 1e-3, -5e-4, 0]),
    )
    projector = Lens(
        400,
        300,
        np.array([[620.0, 0, 197], [0, 621, 160], [0, 0, 1]]),
        np.array([-0.04, 0, 0, 0, 0]),
    )
    turn = Rotation.from_euler('y', 0.28).as_matrix()
    return Rig(camera, projector, turn, np.array([-0.2, 0.005, 0.03]))


@pytest.fixture(scope='module')
def poses(rig):
    rng = np.random.default_rng(5)
    return [random_pose(BOARD, rig, 0.7, rng) for _ in range(4)]


@pytest.fixture(scope='module')
def taken(rig, poses):
    return photographs(rig, BOARD, SEQUENCE, poses, LIGHT)


@pytest.fixture
def folder(taken, tmp_path):
    """Three poses as files."""
    for index in range(3):
        below = tmp_path / 'poses' / f'pose_{index}'
        below.mkdir(parents=True)
        for number, frame in enumerate(SEQUENCE.frames):
            cv2.imwrite(str(below / f'{frame.name}_{number:02d}.png'), taken[index][frame])
    write_session(tmp_path / 'poses', Session(BOARD, SEQUENCE))
    return tmp_path / 'poses'


def test_corners_and_projector_pixels_are_true(rig, poses, taken):
    for pose, each in zip(poses, taken, strict=True):
        sight = observe('pose', each, SEQUENCE, BOARD)
        camera, projector = true_correspondences(BOARD, rig, pose)
        for got, true in (
            (sight.observation.camera, camera),
            (sight.observation.projector, projector),
        ):
            off = got - true
            assert np.isfinite(off).all()
            assert np.sqrt(np.square(off).sum(axis=1).mean()) < 0.05
            assert np.abs(off.mean(axis=0)).max() < 0.03
        assert sight.moved_px < 0.1
        assert 0.3 < sight.blur_px < 1.0


@pytest.mark.skipif(
    not hasattr(cv2, 'aruco'), reason='this OpenCV has no ArUco: ChArUco is not tested'
)
def test_a_charuco_board_may_be_seen_in_part(rig):
    board = Board(6, 5, 0.04, 'DICT_4X4_50', 0.03)
    pose = random_pose(replace(board, columns=4), rig, 0.6, np.random.default_rng(1))
    gray = photographs(rig, board, GRAY, [pose], LIGHT)[0]
    sight = observe('pose', gray, GRAY, board)
    camera, projector = true_correspondences(board, rig, pose)
    seen = np.isfinite(sight.observation.camera[:, 0])
    assert 12 <= seen.sum() <= 30
    assert np.abs(sight.observation.camera - camera)[seen].max() < 0.2
    lit = np.isfinite(sight.observation.projector).all(axis=1)
    assert lit.sum() >= 12
    off = np.abs(sight.observation.projector - projector)[lit]
    assert np.median(off) < 0.1


def test_bad_poses_are_refused_with_their_reason(taken):
    good = taken[0]

    def each(change):
        return {frame: change(image).astype(np.uint8) for frame, image in good.items()}

    def exchanged(kind, *steps):
        first, second = (ProjectedFrame(kind, 'u', step) for step in steps)
        return good | {first: good[second], second: good[first]}

    later = [frame for frame in SEQUENCE.frames if frame.axis == 'v']
    for photos, reason in (
        (good | {f: np.roll(good[f], 2, axis=1) for f in later}, r'moved by 2\.0 pixels'),
        (each(lambda image: cv2.GaussianBlur(image, (0, 0), 6)), 'blurred'),
        (each(lambda image: np.clip(4.0 * image, 0, 255)), 'saturated'),
        (each(lambda image: np.where(np.arange(640) < 320, image, 0)), 'seen whole'),
        (exchanged('gray', 1, 2), 'out of order'),
        (exchanged('shift', 1, 3), 'out of order'),
    ):
        with pytest.raises(CalibrationError, match=reason):
            observe('pose', photos, SEQUENCE, BOARD)


def test_light_that_changes_is_not_called_disorder(rig, poses, taken):
    gray = photographs(rig, BOARD, GRAY, poses[:1], LIGHT)[0]
    for good, sequence in ((taken[0], SEQUENCE), (gray, GRAY)):
        gains = np.random.default_rng(3).uniform(0.4, 1.0, len(good))
        dimmed = {
            frame: (gain * image).astype(np.uint8)
            for gain, (frame, image) in zip(gains, good.items(), strict=True)
        }
        with pytest.raises(CalibrationError, match='light changes from photograph to photograph'):
            observe('pose', dimmed, sequence, BOARD)


def test_a_projector_described_upright_is_told(taken):
    exchanged = replace(SEQUENCE, width=SEQUENCE.height, height=SEQUENCE.width)
    with pytest.raises(CalibrationError, match='the projector has 300 of them: give its width'):
        for each in taken:
            observe('', each, exchanged, BOARD)


def test_the_command_says_what_it_left_out_and_writes_nothing_by_halves(folder, tmp_path, capsys):
    rig_file = tmp_path / 'rig.yaml'
    arguments = ['calibrate', 'solve', str(folder), '--output', str(rig_file)]
    for number in (3, 4, 5):
        shutil.copytree(folder / 'pose_0', folder / f'pose_{number}')
    for path in list((folder / 'pose_3').iterdir()):
        cv2.imwrite(str(path), np.zeros((480, 640), np.uint8))
    next((folder / 'pose_4').iterdir()).write_bytes(b'no image')
    next((folder / 'pose_5').iterdir()).unlink()
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert 'left out: pose_3: no chessboard of 7x6' in said
    assert f'left out: pose_4: {folder}/pose_4/' in said
    assert 'left out: pose_5: has' in said and 'no photograph is missing' in said
    assert read_rig(rig_file).record.poses == 3
    assert rig_file.with_suffix('.html').is_file()
    rig_file.unlink()
    shutil.rmtree(folder / 'pose_0')
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith('ftp-dent calibrate: ')
    assert 'fewer than 3' in error
    assert not rig_file.exists()


def test_folders_that_cannot_be_used(tmp_path, capsys):
    options = ['--board', '7x6', '--square', '30', '--projector', '400x300']

    def refused(*words):
        assert main(['calibrate', 'solve', *words]) == 2
        return capsys.readouterr().err.strip().splitlines()[-1]

    assert 'no such folder' in refused(str(tmp_path / 'nowhere'), *options)
    assert 'holds no folders' in refused(str(tmp_path), *options)
    (tmp_path / 'pose').mkdir()
    (tmp_path / 'pose' / 'first.png').write_bytes(b'')
    assert 'does not end in a number' in refused(str(tmp_path), *options)
    assert 'the board is not known' in refused(str(tmp_path))
    assert 'give two whole numbers' in refused(str(tmp_path), '--board', '7', '--square', '30')


def test_a_session_is_kept_in_its_folder(tmp_path):
    session = Session(Board(7, 6, 0.03), SEQUENCE, 0.25, 0.05)
    write_session(tmp_path, session)
    assert read_session(tmp_path) == session


def test_real_photographs(shared):
    board, sequence = Board(7, 9, 0.075), Sequence(1024, 768, period=0)
    sights, left_out, size = see_poses(shared / 'real' / 'calibration', Session(board, sequence))
    assert (len(sights), left_out, size) == (5, [], (1280, 1024))
    observations = [sight.observation for sight in sights]
    found = solve(observations, board, size, (1024, 768), model=Model(3, 3, bent=True))
    camera, projector, joint = found.estimate.rms()
    assert camera < 0.35
    assert projector < 0.25
    assert joint < 0.30
    assert 1800 < found.rig.projector.camera_matrix[0, 0] < 2000
    mistaken = [replace(o, projector=o.projector[:, ::-1]) for o in observations]
    with pytest.raises(CalibrationError, match='rows and columns are exchanged'):
        solve(mistaken, board, size, (1024, 768))


@pytest.mark.parametrize('shift', [2, 4, 8])
def test_photographs_of_more_bits_keep_their_brightness_to_each_other(tmp_path, shift):
    count = len(SEQUENCE.frames)
    levels = np.random.default_rng(0).integers(0, 200, (count, 20, 30), np.uint8)
    levels[0, 0, 0], levels[2] = 255, levels[2] // 40
    levels[1] //= 2
    files = {number: tmp_path / f'{number}.png' for number in range(count)}
    for path, image in zip(files.values(), levels, strict=True):
        assert cv2.imwrite(str(path), image.astype(np.uint16) << shift)
    read = read_pose(files, SEQUENCE)
    for frame, image in zip(SEQUENCE.frames, levels, strict=True):
        np.testing.assert_array_equal(read[frame], image)
