"""Plates on the skin are steps all round, not bumps, and dents on and beside them are measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf
from small_clouds import cloud_of, panel, raised

from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Panel

BESIDE = Dent(-0.065, 0.0, 0.03, 0.03, 0.0005)
ON_IT = Dent(0.0, 0.0, 0.03, 0.03, 0.0004)
HALF = 0.04, 0.03


@pytest.mark.parametrize('height', [0.0005, 0.001, 0.002])
@pytest.mark.parametrize('angle', [0.3, 1.2])
def test_a_plate_is_a_step_all_round_and_its_dents_are_measured_on_it(height, angle):
    lower = panel(BESIDE, tilt=(0, 0))
    plate = lower.pose @ Pose.from_rpy((0, 0, angle), (0.02, 0, -height))
    (x, y) = HALF
    found = inspect(cloud_of(Panel(plate, (-x, x, -y, y), dents=(ON_IT,)), lower))
    (step,) = found.others
    assert (step.kind, step.is_cut) == ('step', False)
    assert 'doubler' in step.reason
    assert step.depth.value == pytest.approx(height, abs=2e-5)
    np.testing.assert_allclose(step.position[:2], plate.translation[:2], atol=2e-3)
    assert abs(step.axis @ plate.rotation.apply([1, 0, 0])) > 0.99
    for told, true in ((step.length, 2 * x), (step.width, 2 * y)):
        assert abs(told.value - true) < 2 * told.uncertainty < 8e-3
    for true, pose in ((BESIDE, lower.pose), (ON_IT, plate)):
        at = pose.apply(np.array([true.x, true.y, 0.0]))[:2]
        (dent,) = (d for d in found.dents if np.linalg.norm(d.position[:2] - at) < 2e-3)
        assert abs(dent.depth.value - true.depth) < 3 * dent.depth.uncertainty


def outward(cloud, height, flank):
    """What stands out by a height over 60 mm, and falls within a flank all round."""
    x, y = cloud.points[..., 0], cloud.points[..., 1]
    return raised(cloud, -height * (0.5 + 0.5 * erf((0.03 - np.hypot(x, y)) / flank)))


def test_what_is_round_at_its_flanks_is_a_bump():
    (bump,) = inspect(outward(cloud_of(panel(tilt=(0, 0))), 0.001, 0.01)).others
    assert bump.kind == 'bump'


def test_a_round_patch_is_a_step():
    (step,) = inspect(outward(cloud_of(panel(tilt=(0, 0))), 0.001, 0.0012)).others
    assert step.kind == 'step' and step.length.value == pytest.approx(0.06, abs=3e-3)


def test_what_is_pressed_in_with_steep_flanks_is_a_dent():
    (dent,) = inspect(outward(cloud_of(panel(tilt=(0, 0))), -0.001, 0.004)).dents
    assert dent.depth.value == pytest.approx(0.001, rel=0.02)


def test_an_opening_in_a_plate_shows_the_skin_and_no_dent():
    cloud = cloud_of(panel(tilt=(0, 0)))
    x, y = cloud.points[..., 0], cloud.points[..., 1]
    within = np.minimum(0.04 - np.maximum(abs(x), abs(y)), np.hypot(x, y) - 0.018)
    found = inspect(raised(cloud, -0.001 * (0.5 + 0.5 * erf(within / 1.2e-3))))
    assert found.dents == ()
    assert {each.kind for each in found.others} == {'step'}
