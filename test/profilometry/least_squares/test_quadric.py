import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.fit.quadric import evaluate, robust_quadric

COEFFICIENTS = np.array([1.5, 0.2, -0.1, 0.3, 0.05, -0.2])


@pytest.fixture
def rays():
    grid = np.meshgrid(np.linspace(-0.3, 0.35, 25), np.linspace(-0.2, 0.2, 20))
    return np.stack(grid, axis=-1).astype(np.float32)


def test_dents_and_noise_are_no_part_of_it(rays):
    true = evaluate(COEFFICIENTS, rays)
    seen = true + 1e-5 * np.random.default_rng(0).standard_normal(true.shape, np.float32)
    seen[5:9, 6:11] += 0.004  # a dent over 4 % of the skin
    fitted = robust_quadric(rays.reshape(-1, 2), seen.ravel())
    np.testing.assert_allclose(evaluate(fitted, rays), true, atol=1.2e-5)


def test_a_surface_that_it_is_comes_back(rays):
    fitted = robust_quadric(rays.reshape(-1, 2), evaluate(COEFFICIENTS, rays).ravel())
    np.testing.assert_allclose(fitted, COEFFICIENTS, atol=2e-4)


def test_few_points_on_a_line_give_something_finite():
    rays = np.stack([np.linspace(0, 0.1, 6), np.zeros(6)], axis=-1).astype(np.float32)
    assert np.isfinite(robust_quadric(rays, np.full(6, 1.5, np.float32))).all()
