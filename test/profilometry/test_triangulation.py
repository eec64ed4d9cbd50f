from dataclasses import replace

import numpy as np
import pytest
from small_scenes import DISTORTED, INVERTED, RIG

from ftp_dent_ros.profilometry.triangulation import triangulate

FULL = replace(
    RIG,
    camera=replace(RIG.camera, distortion=np.array([-0.2, 0.08, 1e-3, -2e-3, 0.01])),
    projector=replace(RIG.projector, distortion=np.array([0.1, -0.05, -2e-3, 1e-3, 0.02])),
)


@pytest.mark.parametrize(
    'rig', [RIG, INVERTED, DISTORTED, FULL], ids=['plain', 'inverted', 'distorted', 'full']
)
def test_inverts_the_projection(rig):
    low, high = (-0.2, -0.15, 0.5), (0.2, 0.15, 0.9)
    points = np.random.default_rng(0).uniform(low, high, (70, 50, 3))
    rays = rig.camera.rays(rig.camera.project(points)).astype(np.float32)
    u_p, v_p = np.moveaxis(rig.projector.project(rig.to_projector(points)), -1, 0)
    depth, row = triangulate(rig, rays, u_p.astype(np.float32))
    assert depth.dtype == row.dtype == np.float32
    # 1e-6 m is what single precision leaves of a column.
    np.testing.assert_allclose(depth, points[..., 2], atol=3e-6)
    np.testing.assert_allclose(row, v_p, atol=3e-3)


def test_missing_columns_stay_missing():
    rays = np.ones((2, 3, 3), np.float32)
    depth, _ = triangulate(RIG, rays, np.full((2, 3), np.nan, np.float32))
    assert np.isnan(depth).all()


def test_nothing_lies_behind_the_camera():
    rays = RIG.camera.rays(RIG.camera.pixel_grid(40)).astype(np.float32)
    columns = np.broadcast_to(np.linspace(-4000, 4000, 16, dtype=np.float32), rays.shape[:2])
    depth, _ = triangulate(RIG, rays, columns)
    assert np.isnan(depth).any()
    assert (depth[np.isfinite(depth)] > 0).all()
