"""A photograph of another renderer, rendered again from its scene's numbers."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import CameraMotion, Dent, Paint, Panel, Photometry, Renderer, Surface
from ftp_dent_ros.simulation.view import see


class Scene:
    """A photograph, and what should be seen in it."""

    def __init__(self, folder):
        scene = json.loads((folder / 'scene.json').read_text())
        self.rig = read_rig(folder / 'rig.yaml')
        self.image = _read(folder / 'image.png')
        self.projected = _read(folder / 'pattern.png')
        self.truth = dict(np.load(folder / 'truth.npz'))
        self.step = int(self.truth['step'])
        self.surface = Surface((_panel(scene['surface']),))
        self.reference_distance = scene['median_depth_m']
        motion = scene['motion']
        self.motion = CameraMotion(
            translation=np.array(motion['velocity_m_s'], float) * motion['exposure_s']
        )
        self.seen = self.truth['valid'] & ~self.truth['edge']

    def sampled(self, values):
        """Where the truth is known."""
        return values[:: self.step, :: self.step][self.seen]

    def render(self):
        """The photograph without noise, as bright as theirs: its exposure is not told."""
        photometry = Photometry(
            full_well=1e15, read_noise=0.0, reference_distance=self.reference_distance
        )
        for _ in range(2):
            renderer = Renderer(self.rig, self.projected, photometry)
            image = renderer.render(self.surface, motion=self.motion).astype(float)
            theirs, ours = (self.sampled(part).ravel() for part in (self.image, image))
            gain = float(ours @ theirs / (ours @ ours))
            photometry = dataclasses.replace(photometry, exposure=photometry.exposure * gain)
        return image


def _read(path):
    return np.ascontiguousarray(cv2.imread(str(path))[..., ::-1])


def _panel(surface):
    (panel,) = surface['panels']
    turn = Rotation.from_matrix(np.reshape(panel['R_po'], (3, 3)))
    dents = [
        Dent(d['x'], d['y'], d['length'], d['width'], d['depth'], np.radians(d['angle_deg']))
        for d in surface['dents']
    ]
    return Panel(
        Pose(turn, np.array(panel['t_po'])),
        tuple(panel['extent']),
        panel['cylinder_radius'],
        Paint((panel['albedo'],) * 3),
        tuple(dents),
    )


@pytest.fixture(scope='module', params=['static_A', 'dynamic_C'])
def scene(data, request):
    return Scene(data / 'scenes' / request.param)


def test_depth_and_projector_columns_are_theirs(scene):
    """Both of their files' are float32."""
    rays = scene.rig.camera.rays(scene.rig.camera.pixel_grid(scene.step))
    depth = scene.surface.intersect(rays)
    np.testing.assert_allclose(depth[scene.seen], scene.truth['z'][scene.seen], atol=2e-7)
    column = see(scene.rig, scene.surface, Photometry()).u
    np.testing.assert_allclose(scene.sampled(column), scene.truth['up'][scene.seen], atol=1e-4)


def test_levels_and_fringes_are_theirs(scene):
    ours, theirs = scene.render(), scene.image.astype(float)
    difference = scene.sampled(ours - theirs)
    # Theirs has noise: 12000 electrons at 255 levels, and 0.8 of reading.
    noise = np.sqrt((scene.sampled(theirs) * 255 / 12000 + 0.8**2 + 1 / 12).mean())
    assert np.sqrt((difference**2).mean()) < 1.3 * noise

    column = see(scene.rig, scene.surface, Photometry()).u
    period = 8.0
    wave = np.exp(-2j * np.pi / period * column)
    inside = cv2.erode(
        np.repeat(np.repeat(scene.seen, scene.step, 0), scene.step, 1).astype(np.uint8),
        np.ones((61, 61), np.uint8),
    )
    red, blue = 0, 2
    for channel in (red, blue):
        phases = []
        for image in (ours, theirs):
            signal = image[..., channel] - cv2.blur(image[..., channel], (61, 61))
            product = signal * wave
            smooth = [cv2.GaussianBlur(part, (0, 0), 8) for part in (product.real, product.imag)]
            phases.append(smooth[0] + 1j * smooth[1])
        lag = np.angle(phases[0] * phases[1].conj())
        # The stripe has no fringes in blue.
        at = (inside > 0) & (np.abs(phases[1]) > 0.5 * np.median(np.abs(phases[1][inside > 0])))
        assert at.sum() > 10_000
        assert np.sqrt((lag[at] ** 2).mean()) < 0.02
        assert abs(lag[at].mean()) < 0.002
