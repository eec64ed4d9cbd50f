"""Panels and their unions: intersection and distance, against closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Panel, Rivet, Surface

POSE = Pose(Rotation.from_euler('xyz', [0.2, -0.3, 0.5]), np.array([0.05, -0.02, 0.8]))
EXTENT = (-0.3, 0.3, -0.2, 0.2)


def rays(count=500, seed=3):
    sideways = np.random.default_rng(seed).uniform(-0.1, 0.1, (count, 2))
    return np.column_stack([sideways, np.ones(count)])


@pytest.mark.parametrize('radius', [0.0, 1.5])
def test_a_dent_is_met_on_its_own_height(radius):
    dents = Dent(0.02, 0.01, 0.2, 0.12, 0.006, 0.4), Dent(-0.06, 0.01, 0.08, 0.08, -0.003)
    rivets = (Rivet(0.1, 0.05, radius=0.02, sigma=0.002),)
    panel = Panel(POSE, EXTENT, radius, dents=dents, rivets=rivets)
    depth = Surface((panel,)).intersect(rays(4000))
    x, y, z = POSE.inverse().apply(depth[:, None] * rays(4000)).T
    bare = radius - np.sqrt(radius**2 - x**2) if radius else 0
    rise = sum(feature.height(x, y)[0] for feature in panel.features)
    assert (np.abs(rise) > 1e-4).sum() > 500
    np.testing.assert_allclose(z, bare + rise, atol=1e-9)


def test_beyond_the_extent_and_behind_the_eye_there_is_nothing():
    panel = Panel(Pose(Rotation.identity(), np.array([0, 0, 1.0])), (-0.1, 0.1, -0.05, 0.05))
    seen = Surface((panel,)).intersect([[0, 0, 1], [0.11, 0, 1], [0, 0.051, 1], [0, 0, -1]])
    np.testing.assert_allclose(seen, [1, np.nan, np.nan, np.nan])


def test_the_nearer_of_two_panels_is_met():
    near, far = (
        Panel(Pose(Rotation.identity(), np.array([0, 0, z])), extent)
        for z, extent in ((0.95, (-0.5, 0.0, -0.5, 0.5)), (1.0, (-0.5, 0.5, -0.5, 0.5)))
    )
    seen = Surface((far, near)).intersect([[-0.1, 0, 1], [0.1, 0, 1]])
    np.testing.assert_allclose(seen, [0.95, 1.0])


@pytest.mark.parametrize('radius', [0.0, 1.5])
def test_distance_from_the_bare_skin_is_the_closed_form(radius):
    rng = np.random.default_rng(5)
    at = np.column_stack([rng.uniform(-0.2, 0.2, (300, 2)), rng.uniform(-0.1, 0.1, 300)])
    expected = radius - np.hypot(at[:, 0], radius - at[:, 2]) if radius else at[:, 2]
    # Off the end of the skin the closest point is its rim.
    at = np.vstack([at, [0.0, 0.25, 0.01]])
    expected = np.append(expected, math.hypot(0.05, 0.01))
    distance = Surface((Panel(POSE, EXTENT, radius),)).distance(POSE.apply(at))
    np.testing.assert_allclose(distance, expected, atol=1e-12)


@pytest.mark.parametrize('radius', [0.0, 1.5])
def test_distance_from_a_dent_is_the_least_one(radius):
    dents = (Dent(0.02, 0.01, 0.08, 0.05, 0.003, 0.4), Dent(0.06, 0.03, 0.05, 0.05, -0.001))
    panel = Panel(POSE, EXTENT, radius, dents=dents)

    def skin(place):
        x, y = (np.array([value]) for value in place)
        return np.array([x[0], y[0], panel.height(x, y)[0][0]])

    rng = np.random.default_rng(6)
    for _ in range(12):
        x, y = rng.uniform([-0.02, -0.01], [0.08, 0.05])
        offset = rng.uniform(-0.002, 0.002)
        point = skin((x, y)) + np.array([0, 0, offset])
        best = minimize(
            lambda place, point=point: 1e6 * np.sum((skin(place) - point) ** 2),
            (x, y),
            method='Nelder-Mead',
            options={'xatol': 1e-9, 'fatol': 1e-12},
        )
        expected = math.copysign(math.sqrt(best.fun / 1e6), offset)
        distance = Surface((panel,)).distance(POSE.apply(point))
        assert distance == pytest.approx(expected, abs=1e-6)


def test_points_on_the_skin_are_at_no_distance_whatever_moves():
    panel = Panel(
        POSE, EXTENT, 2.0, dents=(Dent(0, 0, 0.1, 0.08, 0.003),), rivets=(Rivet(0.1, 0),)
    )
    surface = Surface((panel,))
    points = surface.intersect(rays())[:, None] * rays()
    assert np.abs(surface.distance(points)).max() < 1e-9
    assert np.isnan(surface.distance([np.nan, 0, 1]))
    move = Pose.from_rpy([0.4, 1.0, -2.0], [3.0, -20.0, 7.0])
    assert np.abs(surface.transformed(move).distance(move.apply(points))).max() < 1e-9


def test_normals_point_at_the_viewer():
    panel = Panel(POSE, EXTENT, 1.5)
    x, y = np.array([0.0, 0.3]), np.zeros(2)
    lean = math.asin(0.3 / 1.5)
    expected = POSE.rotation.apply([[0, 0, -1], [math.sin(lean), 0, -math.cos(lean)]])
    np.testing.assert_allclose(panel.normal(x, y), expected, atol=1e-12)


def test_a_cylinder_ends_before_its_side_and_an_impossible_panel_is_refused():
    assert Panel(POSE, (-9, 9, -1, 1), 2.0).extent == (-1.8, 1.8, -1, 1)
    with pytest.raises(ConfigurationError, match=r'extent is .*x_min < x_max'):
        Panel(POSE, (0.1, -0.1, 0, 1))
    with pytest.raises(ConfigurationError, match=r'cylinder_radius is -1.0'):
        Panel(POSE, EXTENT, -1.0)
