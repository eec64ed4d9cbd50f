"""Livery and varnish."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Paint, Panel, Surface, render


def directions(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    vectors[:, 2] = -np.abs(vectors[:, 2]) - 0.05
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def test_a_diagonal_edge_parts_two_tones_sharply(rig, pattern, noiseless):
    """Skin that the projector lights evenly: its levels are in the ratio of the albedos."""
    half = np.sqrt(0.5)
    paint = Paint((0.8, 0.8, 0.8), (half, half, 0.0), (0.1, 0.2, 0.4))
    pose = Pose(Rotation.identity(), np.array([0, 0, 0.6]))
    white = np.full((100, 160, 3), 255, np.uint8)
    two, one = (
        render(rig, white, Surface((Panel(pose, (-1, 1, -1, 1), paint=p),)), noiseless)
        for p in (paint, Paint())
    )
    part = two / one.astype(float)
    points = 0.6 * rig.camera.rays(rig.camera.pixel_grid())
    beyond = half * points[..., 0] + half * points[..., 1]
    pixel = 0.6 / 900
    near, far = part[beyond < -pixel], part[beyond > pixel]
    np.testing.assert_allclose(near, 1, atol=1e-9)
    np.testing.assert_allclose(far, np.tile([0.125, 0.25, 0.5], (len(far), 1)), atol=0.01)


def test_varnish_works_both_ways():
    """Light and eye may change places, and matt paint has no gloss."""
    normal = np.tile([0.0, 0.0, -1.0], (50, 1))
    light, eye = directions(50, 1), directions(50, 2)
    paint = Paint(roughness=0.3)
    np.testing.assert_allclose(
        paint.specular(normal, light, eye), paint.specular(normal, eye, light)
    )
    assert not Paint().specular(normal, light, eye).any()


@pytest.mark.parametrize('roughness', [0.1, 0.2, 0.3])
def test_varnish_reflects_its_few_percent(roughness):
    """Looked at from the front: the integral of BRDF times cosine over all light is Fresnel's."""
    count = 400_000
    rng = np.random.default_rng(0)
    cosine, turn = np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)
    sine = np.sqrt(1 - cosine**2)
    light = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), -cosine])
    front = np.tile([0.0, 0.0, -1.0], (count, 1))
    # Directions are drawn by their cosine, so that the mean is the integral of pi f.
    reflected = Paint(roughness=roughness).specular(front, light, front).mean()
    assert 0.85 * 0.04 < reflected < 1.05 * 0.04
