from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ftp_dent_ros.calibration.rig_check import AXES, CheckAside, adjusted, check, turned
from ftp_dent_ros.cli.main import main
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import write_rig
from ftp_dent_ros.simulation import Panel, Photometry, Surface, render

TURNS = ((0.05, 0, 0), (0, -0.05, 0), (0, 0, 0.05), (0.02, 0, 0))


@pytest.fixture(scope='module')
def wall(rig, pattern):
    panel = Panel(Pose.from_rpy((0.03, -0.06, 0.01), (0, 0, 0.75)), (-1, 1, -1, 1))
    light = Photometry(reference_distance=0.75, read_noise=1.5, defocus_px=1.0)
    return render(rig, pattern.draw(), Surface((panel,)), light)


def seen(rig, pattern, image, flatness=2e-5):
    points = Reconstructor(rig, pattern, Settings(stride=4)).measure(image).cloud.points
    return check(rig, pattern, image, points, flatness)


def test_a_good_rig_holds(rig, pattern, wall):
    found = seen(rig, pattern, wall)
    assert found.holds
    assert not found.unknown
    assert np.abs(found.turn / found.deviation).max() < 2
    assert np.abs(found.drift_px).max() < 0.1
    assert 'holds' in found.sentence


@pytest.mark.parametrize('degrees', TURNS)
def test_a_turned_projector_is_found_and_adjusted(rig, pattern, wall, degrees):
    wrong = turned(rig, -np.radians(degrees))
    false = Reconstructor(wrong, pattern, Settings(stride=4)).measure(wall).cloud.points
    found = check(wrong, pattern, wall, false, 2e-5)
    assert not found.holds
    np.testing.assert_allclose(np.degrees(found.turn), degrees, atol=0.004)
    if degrees[1]:
        true = Reconstructor(rig, pattern, Settings(stride=4)).measure(wall).cloud.points
        error = abs(np.nanmedian(false[..., 2] - true[..., 2]))
        assert found.depth_error == pytest.approx(error, rel=0.05)
    mended = adjusted(wrong, found)
    np.testing.assert_allclose(mended.rotation, rig.rotation, atol=1e-4)


def shifted(rig, axis):
    """The rig with its projector's image a pixel further."""
    matrix = rig.projector.camera_matrix.copy()
    matrix[axis, 2] += 1.0
    return replace(rig, projector=replace(rig.projector, camera_matrix=matrix))


def test_a_shift_of_rows_is_found_and_one_of_columns_is_said_to_need_a_board(rig, pattern, wall):
    assert seen(shifted(rig, 1), pattern, wall).moved == ('pitch',)
    blind = seen(shifted(rig, 0), pattern, wall)
    assert blind.holds
    assert 'a shift across the fringes, which a board shows' in blind.sentence


def test_a_rig_with_the_projector_above_is_checked_too(rig, pattern):
    upright, rows = rig.transposed, pattern.transposed
    panel = Panel(Pose.from_rpy((0.06, 0.03, 0.01), (0, 0, 0.75)), (-1, 1, -1, 1))
    light = Photometry(reference_distance=0.75, read_noise=1.5, defocus_px=1.0)
    image = render(upright, rows.draw(), Surface((panel,)), light)
    assert seen(upright, rows, image).holds
    for axis, turn in zip(AXES, np.radians(0.05) * np.eye(3), strict=True):
        found = seen(turned(upright, -turn), rows, image)
        np.testing.assert_allclose(found.turn, turn, atol=np.radians(0.006))
        assert found.moved == (axis,)


def test_a_skin_tells_less(rig, pattern, wall):
    known, found = seen(rig, pattern, wall), seen(rig, pattern, wall, flatness=np.inf)
    assert found.holds
    assert found.deviation[1] > 3 * known.deviation[1]
    with pytest.raises(CalibrationError, match='fewer than 200'):
        check(rig, pattern, wall, np.full((4, 4, 3), np.nan))


def test_a_fuselage_raises_no_alarm_and_shows_a_turn(rig, pattern):
    skin = Panel(Pose.from_rpy((0.05, 0.1, 0.3), (0, 0, 0.7)), (-1, 1, -1, 1), 2.0)
    light = Photometry(reference_distance=0.7, read_noise=1.5, defocus_px=1.0)
    image = render(rig, pattern.draw(), Surface((skin,)), light)
    good = seen(rig, pattern, image, flatness=np.inf)
    assert good.holds
    assert np.abs(good.turn / good.deviation).max() < 2.5
    found = seen(turned(rig, -np.radians([0.05, 0, 0])), pattern, image, flatness=np.inf)
    assert 'pitch' in found.moved


def test_a_camera_that_is_not_straight_shifts_no_rim(rig, pattern, wall):
    bent = (255 * (wall / 255.0) ** (1 / 1.25)).round().astype(np.uint8)
    found = seen(rig, pattern, bent)
    assert found.holds
    assert np.abs(found.drift_px[[0, 2]]).max() < 0.15


def test_a_photograph_without_a_rim_says_what_it_does_not_tell(rig, pattern, wall):
    points = Reconstructor(rig, pattern, Settings(stride=4)).measure(wall).cloud.points
    even = np.full_like(wall, 100)
    found = check(rig, pattern, even, points, np.inf)
    assert found.rim_points == 0
    assert found.unknown == ('pitch', 'yaw', 'roll')
    assert not found.tells and 'this photograph does not tell' in found.sentence
    assert 'pitch' in check(rig, pattern, even, points, 2e-5).unknown


def test_the_command_checks_and_adjusts_but_overwrites_nothing(
    rig, pattern, wall, tmp_path, capsys
):
    image, bad, new = tmp_path / 'wall.png', tmp_path / 'bad.yaml', tmp_path / 'new.yaml'
    cv2.imwrite(str(image), wall[..., ::-1])
    write_rig(bad, turned(rig, np.radians([0.05, 0, 0])))
    options = ['--pattern', str(config_folder() / 'pattern.yaml')]
    command = ['calibrate', 'check', str(image), *options]
    assert main([*command, '--rig', str(bad), '--adjust', str(new)]) == 1
    assert 'the projector has turned, pitch -0.05' in capsys.readouterr().out
    assert main([*command, '--rig', str(new)]) == 0
    before = new.read_bytes()
    assert main([*command, '--rig', str(bad), '--adjust', str(new)]) == 2
    assert 'never overwritten' in capsys.readouterr().err
    assert new.read_bytes() == before


def test_a_check_aside_says_what_the_check_says(rig, pattern, wall):
    wrong = turned(rig, np.radians([0.05, 0, 0]))
    measured = Reconstructor(wrong, pattern, Settings(stride=4)).measure(wall)
    here = check(wrong, pattern, wall, measured.cloud.points, np.inf)
    aside = CheckAside()
    found = aside.check(wrong, pattern, Photograph.of(wall), measured.cloud.points, np.inf)
    assert (found.holds, found.sentence) == (here.holds, here.sentence)
    nothing = np.full((4, 4, 3), np.nan)
    with pytest.raises(CalibrationError, match='fewer than 200'):
        aside.check(rig, pattern, Photograph.of(wall), nothing, np.inf)
    aside.end()
