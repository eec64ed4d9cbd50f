"""Places without points: strips across dents, holes at their bottoms, islands."""

import math
from dataclasses import replace

import numpy as np
import pytest
from small_clouds import COLUMNS, ROWS, cloud_of, panel

from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Panel
from ftp_dent_ros.simulation.dents import Cap, FlatBottomed, Gaussian, Valley

V, U = np.mgrid[:ROWS, :COLUMNS]


def without(cloud, hidden):
    """The cloud without some of its points, which tell how well they are known."""
    points = cloud.points.copy()
    points[hidden] = np.nan
    return replace(cloud, points=points, sigma=np.full((ROWS, COLUMNS), 5e-6, np.float32))


def strip(angle, width, beside=0.0):
    """Points in a strip through the picture, pixels."""
    along = (U - COLUMNS / 2) * math.cos(angle) + (V - ROWS / 2) * math.sin(angle)
    return np.abs(along - beside) < width / 2


@pytest.mark.parametrize('shape', [Gaussian(), Cap(), FlatBottomed(0.5)])
@pytest.mark.parametrize('angle', [0.0, 1.1])
def test_a_dent_on_both_sides_of_a_strip_is_one(shape, angle):
    truth = Dent(0.004, -0.003, 0.05, 0.04, 0.001, 0.6, shape)
    cloud = cloud_of(panel(truth, radius=2.0))
    (dent,) = inspect(cloud).dents

    found = inspect(without(cloud, strip(angle, 5)))

    (cut,) = (*found.dents, *found.others)
    assert cut.kind == 'dent'
    assert cut.is_cut
    assert cut.reason.startswith('cut by what was not measured (')
    for name in ('depth', 'length', 'width'):
        one, whole = getattr(cut, name), getattr(dent, name)
        assert abs(one.value - whole.value) < 2 * math.hypot(one.uncertainty, whole.uncertainty)
        assert one.uncertainty < 0.15 * one.value
    assert np.linalg.norm(cut.position - dent.position) < 1e-3
    missing = [np.isnan(p[:, 1]).any() for p in (cut.length_profile, cut.width_profile)]
    assert any(missing)


def test_a_strip_through_bare_skin_is_nothing():
    found = inspect(without(cloud_of(panel(radius=2.0)), strip(0.4, 8)))
    assert not found.dents
    assert not found.others


def test_panels_of_two_heights_stay_two_beyond_a_strip():
    lower = panel(radius=2.0, tilt=(0, 0))
    up = lower.pose.translation + lower.pose.rotation.apply([0, 0, -3e-4])
    upper = Panel(Pose(lower.pose.rotation, up), (-0.6, 0.0, -0.6, 0.6), 2.0)
    found = inspect(without(cloud_of(upper, lower), strip(0.0, 14)))
    assert not found.dents
    assert np.nanmax(np.abs(found.deviation)) < 1e-4


@pytest.mark.parametrize('part', [0.25, 0.5])
def test_a_crease_is_listed_though_its_bottom_is_not_measured(part):
    crease = Dent(0.0, 0.0, 0.05, 0.012, 0.003, 0.0, Valley(0.05))
    cloud = cloud_of(panel(crease, tilt=(0, 0)))
    bare = cloud_of(panel(tilt=(0, 0)))
    deep = cloud.points[..., 2] - bare.points[..., 2] > part * crease.depth

    found = inspect(without(cloud, deep))

    (listed,) = (*found.dents, *found.others)
    assert listed.kind == 'other'
    assert listed.is_cut
    assert listed.reason.startswith('not measured at its bottom: at least ')
    assert 0.8 * part * crease.depth < listed.depth.value + listed.depth.uncertainty
    assert listed.length.value > 0.02


def test_flanks_that_are_each_too_small_are_listed_together():
    crease = Dent(0.0, 0.0, 0.02, 0.012, 0.002, 0.0, Valley(0.05))
    cloud = cloud_of(panel(crease, tilt=(0, 0)))
    hole = (np.abs(U - COLUMNS / 2) < 7) & (np.abs(V - ROWS / 2) < 3.4)
    (listed,) = inspect(without(cloud, hole)).others
    assert listed.reason.startswith('not measured at its bottom')


def test_an_island_in_a_hole_is_inspected():
    hole = (np.abs(U - 100) < 14) & (np.abs(V - 75) < 14)
    island = (np.abs(U - 100) < 8) & (np.abs(V - 75) < 8)
    found = inspect(without(cloud_of(panel(radius=2.0)), hole & ~island))
    assert np.isfinite(found.deviation[72:79, 97:104]).all()
