"""Dirt, letters, patches, sun and waves: on their own, and in photographs."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import (
    CameraMotion,
    Dirt,
    Lettering,
    Paint,
    PaintPatch,
    Panel,
    Photometry,
    Sunlight,
    Surface,
    Wave,
    render,
    scratches,
    waviness,
)
from ftp_dent_ros.simulation.view import see

AHEAD = Pose(Rotation.from_euler('xyz', [0.1, -0.08, 0.2]), np.array([0.004, -0.003, 0.6]))
WIDE = (-0.5, 0.5, -0.5, 0.5)


def skin(**options):
    return Surface((Panel(AHEAD, WIDE, **options),))


def test_dirt_has_its_contrast_in_grains_of_its_scales():
    x = np.tile(np.arange(0, 0.4, 0.0005, np.float32), (500, 1))
    y = np.arange(0, 0.25, 0.0005, dtype=np.float32)[:, None] + 0 * x
    dirt = Dirt(0.5, (0.004,), seed=3)
    factor = dirt.factor(x, y)
    assert factor.mean() == pytest.approx(1, abs=0.01)
    assert np.mean(np.abs(factor - 1) < 0.5) == pytest.approx(0.99, abs=0.004)
    off = factor - factor.mean()
    lag = [np.mean(off[:, :-shift] * off[:, shift:]) / factor.var() for shift in (2, 4, 24)]
    assert lag[0] > 0.75
    assert lag[1] == pytest.approx(0.5, abs=0.08)
    assert abs(lag[2]) < 0.05
    assert (dirt.factor(x, y) == factor).all()
    assert (dataclasses.replace(dirt, seed=4).factor(x, y) != factor).mean() > 0.99
    streaks = Dirt(0.5, (0.004,), seed=3, stretch=10).factor(x, y)
    assert np.abs(np.diff(streaks, axis=1)).mean() < 0.2 * np.abs(np.diff(streaks, axis=0)).mean()
    # A list of places, more than an image is wide.
    np.testing.assert_array_equal(dirt.factor(x.ravel(), y.ravel()), factor.ravel())


def test_letters_are_as_high_as_asked_for_and_painted():
    text = Lettering(0.1, 0.05, 'HI', 0.02, (0.1, 0.1, 0.6))
    y = np.linspace(0.02, 0.08, 601)
    x = np.linspace(0.05, 0.15, 1001)[:, None]
    factor = text.factor(*np.broadcast_arrays(x, y))
    dark = np.flatnonzero(factor[0].min(axis=0) < 0.5)
    assert (dark[-1] - dark[0]) * 1e-4 == pytest.approx(0.02, rel=0.03)
    assert (dark[-1] + dark[0]) / 2 * 1e-4 + 0.02 == pytest.approx(0.05, abs=0.003)
    assert factor[0].min() == pytest.approx(0.1, abs=0.01)
    assert factor[2].min() == pytest.approx(0.6, abs=0.01)


@pytest.mark.parametrize('speed', [0.0, 0.003])
def test_a_patch_is_seen_as_the_same_edge_of_paint_is(rig, pattern, noiseless, speed):
    """The one is sampled everywhere, the other only where it breaks a pixel."""
    photometry = dataclasses.replace(noiseless, samples=64, ambient=0.3, exposure=0.7)
    motion = CameraMotion(translation=np.array([speed, 0, 0]))
    edge = Paint(edge=(1.0, 0.0, 0.004), albedo_beyond=(0.2, 0.3, 0.4))
    patch = PaintPatch(0.254, 0, 0.5, 1.0, (0.25, 0.375, 0.5))
    images = [
        render(rig, pattern.draw(), skin(paint=paint), photometry, motion=motion).astype(float)
        for paint in (edge, Paint(marks=(patch,)))
    ]
    difference = images[1] - images[0]
    assert np.abs(images[0]).max() > 150
    assert np.abs(difference).max() < 6
    assert np.abs(difference).mean() < 0.1


def test_letters_and_scratches_are_seen_where_they_are(rig, pattern, noiseless):
    """Marks are looked for around their places: that must not lose a part of one."""
    marks = (*scratches(6, (-0.03, 0.03, -0.02, 0.02), 2), Lettering(0, 0, 'A', 0.01, (0.2,) * 3))
    whole = render(rig, pattern.draw(), skin(paint=Paint(marks=marks)), noiseless).astype(float)
    plain = render(rig, pattern.draw(), skin(), noiseless).astype(float)
    x, y = (part.astype(np.float32) for part in _places(rig))
    expected = np.ones(x.shape)
    for mark in marks:
        expected *= mark.factor(x, y)[0]
    bright = plain[..., 0] > 60
    part = whole[..., 0] / np.maximum(plain[..., 0], 1)
    assert (expected < 0.5).sum() > 20
    assert np.corrcoef(part[bright], expected[bright])[0, 1] > 0.8


def _places(rig):
    view = see(rig, skin(), Photometry())
    return view.x, view.y


def test_the_sun_adds_its_light_beyond_its_edge(rig, noiseless):
    black = np.zeros((100, 160, 3), np.uint8)
    photometry = dataclasses.replace(noiseless, projector_black=0.0, ambient=0.1, shading=False)
    sun = Sunlight(0.5, (2.0, 0.0, 0.02), softness=0.004)
    image = render(rig, black, skin(sunlight=(sun,)), photometry)[..., 0]
    x, _ = _places(rig)
    assert (image[x < 0.0075] == 20).all()
    assert (image[x > 0.0125] == 120).all()
    middle = np.abs(x - 0.01) < 2e-4
    assert image[middle].mean() == pytest.approx(70, abs=4)


def test_waves_are_traced_and_seen(rig, noiseless):
    waves = (Wave(0.0003, 0.05, 0.4, 1.0), Wave(0.0001, 0.04, 2.0))
    surface = skin(waves=waves, cylinder_radius=0.7)
    rays = rig.camera.rays(rig.camera.pixel_grid())
    depth = surface.intersect(rays)
    x, y, z = AHEAD.inverse().apply((depth[..., None] * rays).reshape(-1, 3)).T
    expected = 0.7 - np.sqrt(0.49 - x * x) + sum(wave.height(x, y)[0] for wave in waves)
    np.testing.assert_allclose(z, expected, atol=1e-10)
    np.testing.assert_allclose(surface.distance(depth[..., None] * rays), 0, atol=1e-8)
    points = rig.to_projector((depth[..., None] * rays).reshape(-1, 3))
    seen = see(rig, surface, noiseless)
    np.testing.assert_allclose(seen.u.ravel(), rig.projector.project(points)[:, 0], atol=2e-3)
    total = sum(wave.height(np.zeros(1), np.zeros(1))[0][0] for wave in waviness(2e-4, 0.1, 5))
    assert abs(total) <= 2e-4
