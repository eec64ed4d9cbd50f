"""Livery and varnish."""

import numpy as np
import pytest

from ftp_dent_ros.simulation import Paint


def directions(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    vectors[:, 2] = -np.abs(vectors[:, 2]) - 0.05
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


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
