import numpy as np
import pytest

from ftp_dent_ros.inspection.measuring.skin.contour_fit import first_contour


def patch(radius):
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-0.2, 0.2, 60)]))
    return np.stack([x, y, 1 + radius - np.sqrt(radius**2 - (x - 0.1) ** 2)], axis=1)


@pytest.mark.parametrize('radius', [0.5, 2.0])
def test_a_cylinder_is_met_exactly_though_a_third_of_it_is_dented(radius):
    points = patch(radius)
    dented = np.hypot(points[:, 0], points[:, 1]) < 0.13
    bare = points.copy()
    points[dented, 2] += 0.003 * (1 - np.hypot(*points[dented, :2].T) / 0.13)

    contour = first_contour(points, np.zeros(3), 1e-5, np.random.default_rng(0))

    _, _, depth = contour.deviation(bare)
    # Of fourth order in the distance from the foot, which is not on the axis here.
    assert np.abs(depth).max() < 2e-5 * (0.5 / radius) ** 3 + 2e-6


def test_normals_point_to_the_viewer():
    contour = first_contour(patch(2.0), np.array([0, 0, 5.0]), 1e-5, np.random.default_rng(0))
    assert contour.normal(np.zeros(1), np.zeros(1))[0] @ [0, 0, 1] > 0.9


def test_points_and_feet_are_inverse():
    contour = first_contour(patch(1.0), np.zeros(3), 1e-5, np.random.default_rng(0))
    x, y = np.array([0.05, -0.1]), np.array([0.0, 0.12])
    foot_x, foot_y, depth = contour.deviation(contour.point(x, y, np.array([0.001, -0.002])))
    assert np.allclose(foot_x, x, atol=2e-6)
    assert np.allclose(foot_y, y, atol=2e-6)
    assert np.allclose(depth, [0.001, -0.002], atol=1e-7)
