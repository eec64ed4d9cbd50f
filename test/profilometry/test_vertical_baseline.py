"""Projectors above or below the camera: level fringes, simulated, not turned photographs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_scenes import PATTERN, Scene, lens, panel

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import MOSAICS, Photograph
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Rig

LEVEL = Pattern(640, 480, 8.0, 240.0, 'v')
# Above the camera, a little beside it, and turned down; and below.
ABOVE = Rig(
    lens(900.0, -0.12),
    lens(940.0, -0.05),
    Rotation.from_euler('xz', (0.3, 0.02)).as_matrix(),
    np.array([0.006, 0.2, 0.03]),
)
BELOW = replace(
    ABOVE,
    rotation=Rotation.from_euler('x', -0.3).as_matrix(),
    translation=np.array([0.006, -0.2, 0.03]),
)


@pytest.mark.parametrize('rig', [ABOVE, BELOW], ids=['above', 'below'])
@pytest.mark.parametrize('method', ['least-squares', 'virtual-reference'])
def test_the_cloud_lies_on_the_true_surface(rig, method):
    seen = Scene.of(panel(tilt=(0.05, 0.1)), rig=rig, projected=LEVEL.draw())
    cloud = Reconstructor(rig, LEVEL, Settings(method, stride=2)).reconstruct(seen.image)
    lit = seen.lit()[::2, ::2]
    assert cloud.valid.shape == lit.shape
    assert (cloud.valid & lit).sum() / lit.sum() > 0.95
    assert (cloud.valid & ~lit).mean() < 1e-3
    assert seen.errors_mm(cloud).mean() < (0.035 if method == 'least-squares' else 0.1)
    # On their own pixels' rays.
    pixels = rig.camera.pixel_grid(2)[cloud.valid]
    np.testing.assert_allclose(rig.camera.project(cloud.points[cloud.valid]), pixels, atol=0.01)


@pytest.mark.parametrize('rig', [ABOVE, BELOW], ids=['above', 'below'])
def test_the_stated_uncertainty_holds(rig):
    seen = Scene.of(panel(half=0.2), rig=rig, projected=LEVEL.draw())
    cloud = Reconstructor(rig, LEVEL, Settings(stride=4)).reconstruct(seen.image)
    error = 1e-3 * seen.errors_mm(cloud) / cloud.sigma[cloud.valid]
    assert 0.7 < np.sqrt(np.mean(np.square(error))) < 1.4


def test_a_transposed_rig_projects_to_transposed_pixels():
    points = np.random.default_rng(0).uniform((-0.1, -0.1, 0.5), (0.1, 0.1, 0.8), (50, 3))
    swapped = points[:, [1, 0, 2]]
    turned = ABOVE.transposed
    np.testing.assert_allclose(
        turned.camera.project(swapped), ABOVE.camera.project(points)[:, ::-1]
    )
    np.testing.assert_allclose(
        turned.projector.project(turned.to_projector(swapped)),
        ABOVE.projector.project(ABOVE.to_projector(points))[:, ::-1],
    )


@pytest.mark.parametrize('mosaic', MOSAICS)
def test_a_transposed_mosaic_has_its_colours_where_the_pixels_are(mosaic):
    colours = dict(zip('rgb', (10, 20, 30), strict=True))
    tile = np.array([colours[colour] for colour in mosaic], np.uint8).reshape(2, 2)
    turned = Photograph(np.tile(tile, (4, 6)), mosaic=mosaic).transposed
    for colour, row, column in turned.lattices():
        assert (turned.pixels[row::2, column::2] == colours[colour]).all()


def test_fringes_along_the_baseline_are_refused():
    with pytest.raises(PatternError, match=r'above or below the camera.* axis v'):
        Reconstructor(ABOVE, PATTERN)
    with pytest.raises(PatternError, match=r'beside the camera.* axis u'):
        turned = ABOVE.transposed
        Reconstructor(turned, replace(LEVEL, width=480, height=640))
