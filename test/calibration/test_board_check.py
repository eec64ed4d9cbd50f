"""A rig checked by one photograph of a board in the flight's pattern."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from boards import board_surface

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.rig_check import check_by_board, turned
from ftp_dent_ros.cli.main import main
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import write_rig
from ftp_dent_ros.simulation import Photometry, Surface, render
from ftp_dent_ros.simulation.paint import board_print

BOARD = Board(10, 7, 0.025)
POSE = Pose.from_rpy((0.3, -0.2, 0.1), (-0.11, -0.09, 0.75))
LIGHT = Photometry(reference_distance=0.75, read_noise=1.5, defocus_px=1.2)
OPTIONS = ['--board', '10x7', '--square', '25', '--pattern', str(config_folder() / 'pattern.yaml')]


@pytest.fixture(scope='module')
def photograph(rig, pattern):
    return render(rig, pattern.draw(), board_surface(BOARD, POSE), LIGHT)


@pytest.fixture(scope='module')
def marked(rig, pattern):
    return render(rig, pattern.draw(), board_surface(charuco(), POSE), LIGHT)


def charuco():
    if not hasattr(cv2, 'aruco'):
        pytest.skip('this OpenCV has no ArUco: ChArUco is not tested')
    return Board(10, 7, 0.025, 'DICT_5X5_100', 0.018)


@pytest.fixture(params=['chessboard', 'ChArUco'])
def seen(request):
    """A board and its photograph."""
    if request.param == 'chessboard':
        return BOARD, request.getfixturevalue('photograph')
    return charuco(), request.getfixturevalue('marked')


def test_a_good_rig_holds(rig, pattern, seen):
    found = check_by_board(rig, pattern, *seen)
    assert found.holds
    assert found.camera_px < 0.12
    assert np.abs(found.turn / found.deviation).max() < 2.5
    assert np.abs(found.drift_px[1:]).max() < 0.3
    # Fringes of columns tell a board's rows next to nothing.
    assert found.deviation[0] > 4 * found.deviation[1]


@pytest.mark.parametrize(
    ('seen', 'degrees', 'axis'),
    [
        ('chessboard', (0, 0.05, 0), 1),
        ('chessboard', (0, 0, -0.05), 2),
        ('ChArUco', (0, 0.2, 0), 1),
    ],
    indirect=['seen'],
)
def test_a_turned_projector_is_found_in_pixels_and_millimetres(rig, pattern, seen, degrees, axis):
    """Also by more than half a fringe, which is 0.15 degrees."""
    found = check_by_board(turned(rig, -np.radians(degrees)), pattern, *seen)
    assert not found.holds
    assert np.degrees(found.turn[axis]) == pytest.approx(degrees[axis], abs=0.01)
    assert found.camera_holds
    if axis == 1:
        # 0.05 degrees are 1.65 projector columns: 2.35 mm of a wall's cloud at 0.75 m.
        assert 2e-3 < found.depth_error / (degrees[1] / 0.05) < 3e-3


def test_a_projector_shifted_by_a_pixel_is_found(rig, pattern, photograph):
    matrix = rig.projector.camera_matrix.copy()
    matrix[0, 2] += 1.0
    shifted = replace(rig, projector=replace(rig.projector, camera_matrix=matrix))
    found = check_by_board(shifted, pattern, BOARD, photograph)
    assert found.moved == ('yaw',)
    assert abs(found.drift_px[1]) == pytest.approx(1, abs=0.3)


def test_coded_fringes_are_counted_by_their_contrast(rig, pattern):
    coded = replace(pattern, code='contrast')
    # Ten by eight squares look the same from both ends; this print's first square is white.
    board = Board(9, 7, 0.025)
    ink = board_print(board)
    ink = replace(ink, ink=np.pad(~ink.ink[20:-20, 20:-20], 20))
    (panel,) = board_surface(board, POSE).panels
    surface = Surface((replace(panel, paint=ink),))
    image = render(rig, coded.draw(), surface, LIGHT)
    found = check_by_board(turned(rig, np.radians([0, -0.6, 0])), coded, board, image)
    assert found.moved == ('yaw',)
    assert np.degrees(found.turn[1]) == pytest.approx(0.6, abs=0.02)
    assert found.camera_px < 0.12


def test_another_board_or_lens_is_told_from_a_turn(rig, pattern, photograph):
    lens = replace(rig.camera, distortion=rig.camera.distortion + np.eye(5)[0] * 0.3)
    found = check_by_board(replace(rig, camera=lens), pattern, BOARD, photograph)
    assert not found.camera_holds
    assert 'pixels from where' in found.sentence
    with pytest.raises(CalibrationError, match='no chessboard of 9x6'):
        check_by_board(rig, pattern, Board(9, 6, 0.025), photograph)
    for told, reason in (
        (replace(pattern, code='stripe'), 'stripe is not seen'),
        (replace(pattern, period_px=9.0), 'code of the fringes'),
    ):
        with pytest.raises(CalibrationError, match=reason):
            check_by_board(rig, told, BOARD, photograph)


def test_the_command_checks_by_a_board(rig, marked, tmp_path, capsys):
    image, bad, new = tmp_path / 'board.png', tmp_path / 'bad.yaml', tmp_path / 'new.yaml'
    cv2.imwrite(str(image), marked[..., ::-1])
    write_rig(bad, turned(rig, np.radians([0, 0.06, 0])))
    command = ['calibrate', 'check', str(image), *OPTIONS]
    command += ['--charuco', charuco().dictionary, '--marker', '18']
    assert main([*command, '--rig', str(bad), '--adjust', str(new)]) == 1
    assert 'the projector has turned, yaw -0.0' in capsys.readouterr().out
    assert main([*command, '--rig', str(new)]) == 0
    assert "the board's corners 0." in capsys.readouterr().out
    assert main([*command, '--rig', str(new), '--skin']) == 2
    assert '--skin and --board' in capsys.readouterr().err
