"""Dents of three fringes: where light falls on their slopes, sigma has what that feigns."""

import numpy as np
import pytest

from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.simulation import Dent, Panel, Photometry, Renderer, Surface
from ftp_dent_ros.simulation.dents import Gaussian

RIG = make_rig(0.8, 0.24, (640, 360, 1700.0), 1890.0)
PATTERN = Pattern(1280, 720, 10.0, 640.0)
FRINGE = 10.0 / 1890.0 * 0.8  # metres


def of_dents(shading):
    """Errors over sigma in dents, some on bright, some on dark fringes, and beside them."""
    part, _ = Dent(0, 0, 1, 1, 1, 0, Gaussian()).size()
    size = 3 * FRINGE / part
    # Columns are 5.3 fringes apart: each stands at another phase.
    dents = tuple(
        Dent(x, y, size, size, 0.35e-3, 0.0, Gaussian())
        for x in 5.3 * FRINGE * np.arange(-4, 5)
        for y in (-0.04, 0.0, 0.04)
    )
    panel = Panel(Pose.from_rpy((0, 0, 0), (0, 0, 0.8)), (-2, 2, -2, 2), dents=dents)
    surface = Surface((panel,))
    light = Photometry(exposure=1.0, ambient=0.03, shading=shading, reference_distance=0.8)
    photograph = Renderer(RIG, PATTERN.draw(), light).render(surface, np.random.default_rng(5))
    cloud = Reconstructor(RIG, PATTERN, Settings(stride=2)).measure(photograph).cloud
    rays = RIG.camera.rays(RIG.camera.pixel_grid())[::2, ::2]
    truth = surface.intersect(rays)
    error = (cloud.points[..., 2] - truth) * np.linalg.norm(rays, axis=-1)
    return error / cloud.sigma, cloud.valid, rays * truth[..., None], dents


@pytest.mark.parametrize('shading', [True, False])
def test_sigma_has_what_windows_and_light_do_to_narrow_dents(shading):
    ratio, valid, points, dents = of_dents(shading)
    apart = np.min([np.hypot(points[..., 0] - d.x, points[..., 1] - d.y) for d in dents], axis=0)
    inside = ratio[valid & (apart < 1.5 * FRINGE)]
    assert 0.4 < np.sqrt(np.mean(inside**2)) < 1.4
    assert np.mean(np.abs(inside) < 4) > 0.99
