import numpy as np
import pytest
from small_scenes import DISTORTED, INVERTED, PATTERN, RIG

from ftp_dent_ros.profilometry.least_squares.phase_geometry import PhaseGeometry, rays_at

COLUMNS, ROWS = np.arange(3.5, 640, 24), np.arange(2.5, 480, 21)


@pytest.fixture(params=['plain', 'distorted', 'inverted'])
def geometry(request):
    rig = {'plain': RIG, 'distorted': DISTORTED, 'inverted': INVERTED}[request.param]
    return PhaseGeometry.of(rig, PATTERN, COLUMNS, ROWS)


def test_rays_are_the_lens_s(geometry):
    lens = geometry.rig.camera
    exact = lens.rays(np.stack(np.meshgrid(COLUMNS, ROWS), axis=-1))[..., :2]
    np.testing.assert_allclose(rays_at(lens, COLUMNS, ROWS), exact, atol=2e-6)


def test_phase_and_back(geometry):
    inverse_depth = np.linspace(1 / 0.9, 1 / 0.5, geometry.rays[..., 0].size, dtype=np.float32)
    inverse_depth = inverse_depth.reshape(geometry.rays.shape[:2])
    phase = geometry.phase(inverse_depth)
    z = 1 / inverse_depth.astype(float)
    points = np.concatenate([geometry.rays * z[..., None], z[..., None]], axis=-1)
    u, v = np.moveaxis(geometry.rig.projector.project(geometry.rig.to_projector(points)), -1, 0)
    np.testing.assert_allclose(PATTERN.column(phase), u, atol=2e-3)
    back, v_p = geometry.meet(phase)
    np.testing.assert_allclose(back, inverse_depth, rtol=2e-5)
    np.testing.assert_allclose(v_p, v, atol=0.02)


def test_deviation_is_the_change_along_the_ray(geometry):
    phase = geometry.phase(np.full(geometry.rays.shape[:2], 1 / 0.65, np.float32))
    step = np.float32(0.02)
    (near, _), (there, _) = geometry.meet(phase), geometry.meet(phase + step)
    length = np.sqrt(1 + np.square(geometry.rays).sum(axis=-1))
    expected = np.abs(1 / there - 1 / near) * length
    found = geometry.deviation(phase, np.full(phase.shape, step**2, np.float32))
    # Slopes are taken at every fourth point; here these are 80 pixels apart.
    np.testing.assert_allclose(found, expected, rtol=0.12)


def test_some_points_of_a_grid(geometry):
    row, column = np.array([2, 5]), np.array([7, 1])
    part = geometry.at(row, column)
    whole = geometry.phase(np.full(geometry.rays.shape[:2], 1.5, np.float32))
    np.testing.assert_array_equal(
        part.phase(np.full((1, 2), 1.5, np.float32))[0], whole[row, column]
    )
