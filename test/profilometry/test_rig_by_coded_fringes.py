"""Photographs of coded fringes tell whether rig and pattern are those that are told."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from ftp_dent_ros.calibration.rig_check import turned
from ftp_dent_ros.errors import OtherPatternError, RefusedFrameError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.rig_alarm import rig_alarm
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import Dent, Dirt, Paint, Panel, Photometry, Renderer, Surface

RIG = read_rig(config_folder() / 'rig.yaml')
PATTERN = Pattern(1280, 720, 10.0, 640.0, code='contrast')
SKIN = Panel(
    Pose.from_rpy((0.03, -0.04, 0.02), (0, 0, 0.8)),
    (-1, 1, -1, 1),
    paint=Paint(marks=(Dirt(0.1, seed=3),)),
    dents=(Dent(0.02, -0.03, 0.05, 0.04, 0.001),),
)
LIGHT = Photometry(reference_distance=0.8, samples=4)
COARSE = Settings(stride=8)


def photograph(projected, rig=RIG, panel=SKIN):
    return Renderer(rig, projected, LIGHT).render(Surface((panel,)))


@pytest.fixture(scope='module')
def image():
    return photograph(PATTERN.draw())


def check(rig, image, pattern=PATTERN):
    return Reconstructor(rig, pattern, COARSE).measure(image).epipolar


def test_a_true_rig_holds_within_the_stated_uncertainty(image):
    found = check(RIG, image)
    assert found.seen
    assert found.places > 40
    assert abs(found.shift) < 4 * found.shift_deviation
    assert abs(found.turn) < 4 * found.turn_deviation
    assert found.shift_deviation < 0.06
    assert not rig_alarm([found] * 5)


@pytest.mark.parametrize(('degrees', 'pixels'), [(0.03, 0.99), (-0.05, -1.66)])
def test_a_rig_that_has_pitched_is_told(image, degrees, pixels):
    found = check(turned(RIG, np.array([math.radians(degrees), 0, 0])), image)
    assert found.shift == pytest.approx(pixels, abs=4 * found.shift_deviation)
    assert f'{found.shift:+.2f} px' in rig_alarm([found] * 3)


def test_a_zero_told_whole_fringes_elsewhere_gives_the_same_cloud(image):
    told = replace(PATTERN, stripe_center_px=PATTERN.stripe_center_px - 10)
    right, other = (
        Reconstructor(RIG, pattern, COARSE).reconstruct(image) for pattern in (PATTERN, told)
    )
    both = right.valid & other.valid
    assert both.sum() > 0.99 * right.valid.sum()
    away = np.abs(other.points[both] - right.points[both]).max(axis=1)
    assert np.percentile(away, 99) < 2e-5
    assert away.max() < 2e-4


def test_a_zero_told_half_a_fringe_elsewhere_is_refused_by_the_code_with_no_rim_in_view():
    near = replace(SKIN, extent=(-0.08, 0.08, -0.08, 0.08))
    told = replace(PATTERN, stripe_center_px=PATTERN.stripe_center_px - 5)
    with pytest.raises(OtherPatternError, match=r'of another pattern than one of .* at 635'):
        check(RIG, photograph(PATTERN.draw(), panel=near), told)


def scaled(factor):
    """What a projector shows that scales its images."""
    offset = 0.5 * (1 - factor) * np.array([1280, 720])
    turn = np.array([[factor, 0, offset[0]], [0, factor, offset[1]]])
    return cv2.warpAffine(PATTERN.draw(), turn, (1280, 720), flags=cv2.INTER_LINEAR)


@pytest.mark.parametrize(
    'projected',
    [PATTERN.draw()[:, ::-1], PATTERN.draw()[::-1], scaled(1366 / 1280), scaled(1280 / 1366)],
    ids=['mirrored', 'upside down', 'larger', 'smaller'],
)
def test_another_image_than_the_pattern_s_is_refused(projected):
    with pytest.raises(RefusedFrameError):
        check(RIG, photograph(np.ascontiguousarray(projected)))


@pytest.mark.parametrize('period', [52.0, 70.0])
def test_a_pattern_whose_rows_are_another_s_is_refused(image, period):
    with pytest.raises(OtherPatternError, match=r'every 70 px|times as far apart'):
        check(RIG, image, replace(PATTERN, row_period_px=period))


def test_a_projector_above_the_camera_is_checked_too():
    above, level = RIG.transposed, PATTERN.transposed
    pose = Pose.from_rpy((0.04, -0.03, 0.0), (0, 0, 0.8))
    seen = photograph(level.draw(), above, replace(SKIN, pose=pose, paint=Paint()))
    found = check(above, seen, level)
    assert abs(found.shift) < 4 * found.shift_deviation
    assert found.shift_deviation < 0.06
