"""Skins of another renderer's photographs, rendered again from their scenes' numbers."""

import dataclasses
import json
import math

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import (
    Dent,
    Dirt,
    Paint,
    Panel,
    Photometry,
    Renderer,
    Rivet,
    Sunlight,
    Surface,
    Wave,
)
from ftp_dent_ros.simulation.dents import Gaussian
from ftp_dent_ros.simulation.sensor import read_out
from ftp_dent_ros.simulation.view import see

# Kinds of their features.
SMOOTH, GAUSSIAN, WAVE, RIVET = 0, 1, 4, 5
# Theirs has no black level of the projector.
QUIET = Photometry(full_well=1e15, read_noise=0.0, projector_black=0.0, ambient=0.03)
# The shadow's edge is drawn, not told: its line, width and levels as fitted to the picture.
SUN = Sunlight(0.79, (math.cos(0.4547), math.sin(0.4547), 0.01996), 0.0035)


class Scene:
    """A folder's photograph, its truth and the surface of its numbers."""

    def __init__(self, folder):
        self.rig, self.pattern = (
            read_rig(folder / 'rig.yaml'),
            read_pattern(folder / 'pattern.yaml'),
        )
        self.image = np.ascontiguousarray(cv2.imread(str(folder / 'image.png'))[..., ::-1])
        self.truth = dict(np.load(folder / 'gt_depth.npz'))
        self.seen = self.truth['valid'] & ~self.truth['edge']
        numbers = json.loads((folder / 'scene.json').read_text())['surface2']
        self.surface = Surface(
            tuple(
                _panel(panel, index, numbers['feat']) for index, panel in enumerate(numbers['pan'])
            )
        )

    def rendered(self, surface, photometry):
        """Without noise, as bright as theirs: their exposure is not told."""
        light = Renderer(self.rig, self.pattern.draw(), photometry).signal(surface)
        theirs = self.image[::2, ::2][self.seen].ravel()
        ours = 255 * np.moveaxis(light, 0, -1)[::2, ::2][self.seen].ravel()
        light *= np.float32(ours @ theirs / (ours @ ours))
        return read_out(light, photometry, np.random.default_rng(0)).shown().astype(float)


def _panel(numbers, index, features):
    parts = {SMOOTH: [], GAUSSIAN: [], WAVE: [], RIVET: []}
    for panel, kind, x, y, a, b, c, s, height, groove_sigma, proud, _ in features:
        if panel != index:
            continue
        angle = math.atan2(s, c)
        if kind == SMOOTH:
            made = Dent(x, y, 2 * a, 2 * b, height, angle)
        elif kind == GAUSSIAN:
            tenth = 2 * math.sqrt(2 * math.log(10))
            made = Dent(x, y, tenth * a, tenth * b, height, angle, Gaussian())
        elif kind == RIVET:
            made = Rivet(x, y, a, height, groove_sigma, proud)
        else:
            made = Wave(height, a, angle, -2 * math.pi / a * (x * c + y * s))
        parts[int(kind)].append(made)
    return Panel(
        Pose(Rotation.from_matrix(np.reshape(numbers[:9], (3, 3))), np.array(numbers[9:12])),
        tuple(numbers[12:16]),
        numbers[16],
        Paint((numbers[18],) * 3, roughness=numbers[19]),
        (*parts[SMOOTH], *parts[GAUSSIAN]),
        tuple(parts[RIVET]),
        tuple(parts[WAVE]),
    )


@pytest.fixture
def scene(shared):
    def read(name):
        folder = shared / 'eval' / 'scenes' / name
        if not folder.is_dir():
            pytest.skip(f'{folder} is not here')
        return Scene(folder)

    return read


@pytest.mark.parametrize('name', ['geo_lap16', 'real_fuselage'])
def test_depth_and_projector_columns_are_theirs(scene, name):
    """Hail, a lap with its wall, waves on a cylinder; both of their files' are float32."""
    one = scene(name)
    depth = one.surface.intersect(one.rig.camera.rays(one.rig.camera.pixel_grid(2)))
    np.testing.assert_allclose(depth[one.seen], one.truth['z'][one.seen], atol=1e-7)
    column = see(one.rig, one.surface, QUIET).u[::2, ::2]
    off = np.abs(column - one.truth['up'])[one.seen]
    # What is seen at once is without rivets.
    assert np.percentile(off, 99) < 1e-4
    assert off.max() < 0.06


@pytest.mark.parametrize('name', ['geo_lap16', 'hard_sunedge'])
def test_fringes_are_where_theirs_are(scene, name):
    """On both sides of a lap, and of a shadow's edge."""
    one = scene(name)
    surface, light = one.surface, QUIET
    if name == 'hard_sunedge':
        panel = dataclasses.replace(surface.panels[0], sunlight=(SUN,))
        surface, light = Surface((panel,)), dataclasses.replace(QUIET, ambient=0.091, exposure=0.6)
    ours, theirs = one.rendered(surface, light)[..., 0], one.image[..., 0].astype(float)
    # Theirs has noise: 12000 electrons at 255 levels, and 0.8 of reading.
    noise = np.sqrt((theirs[::2, ::2][one.seen] * 255 / 12000 + 0.8**2 + 1 / 12).mean())
    assert np.sqrt(((ours - theirs)[::2, ::2][one.seen] ** 2).mean()) < 1.5 * noise
    phase = 2 * np.pi / one.pattern.period_px * see(one.rig, surface, light).u
    seen = np.repeat(np.repeat(one.seen, 2, 0), 2, 1).astype(np.uint8)
    inside = cv2.erode(seen, np.ones((61, 61), np.uint8)) > 0
    waves = []
    for image in (ours, theirs):
        product = (image - cv2.blur(image, (61, 61))) * np.exp(-1j * phase)
        real, imaginary = (
            cv2.GaussianBlur(part, (0, 0), 8) for part in (product.real, product.imag)
        )
        waves.append(real + 1j * imaginary)
    lag = np.angle(waves[1] * waves[0].conj())[inside]
    assert abs(lag.mean()) < 5e-4
    assert lag.std() < 0.005
    assert np.median(np.abs(waves[1] / waves[0])[inside]) == pytest.approx(1, abs=0.03)


def test_dirt_is_like_theirs(scene):
    """The share of the light that it takes, blurred over 8 and over 20 pixels."""
    one = scene('skin_dirt25')
    panel = one.surface.panels[0]
    dirty = dataclasses.replace(panel, paint=Paint((0.8,) * 3, marks=(Dirt(0.25, seed=5),)))
    ours = one.rendered(Surface((dirty,)), QUIET)
    clean = one.rendered(one.surface, QUIET)
    inside = slice(120, 600), slice(150, 1100)
    for blur in (8, 20):
        spread = []
        for image in (ours, one.image.astype(float)):
            ratio = np.divide(
                *(cv2.GaussianBlur(part[..., 0], (0, 0), blur)[inside] for part in (image, clean))
            )
            spread.append(np.log(ratio).std())
        assert spread[0] == pytest.approx(spread[1], rel=0.3)
