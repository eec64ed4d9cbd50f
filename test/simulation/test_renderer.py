"""The renderer against physics, and against a second, plain renderer."""

import dataclasses
import math

import numpy as np
import pytest
from brute_force import PlainPanel, photograph
from scipy.spatial.transform import Rotation

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import (
    CameraMotion,
    Dent,
    Paint,
    Panel,
    Renderer,
    Rivet,
    Surface,
    render,
)

TURN = Rotation.from_euler('xyz', [0.1, -0.08, 0.2])
ORIGIN = (0.004, -0.003, 0.6)
WIDE = (-0.5, 0.5, -0.5, 0.5)
DENTS = ((0.01, -0.005, 0.04, 0.025, 0.002, 0.5), (-0.02, 0.012, 0.02, 0.02, -0.001, 0.0))


def both(extent=WIDE, radius=0.0, dents=DENTS, edge=None, turn=TURN):
    """The same panel for the two renderers."""
    plain = PlainPanel(turn.as_matrix(), ORIGIN, extent, radius, dents, edge=edge)
    paint = Paint()
    if edge:
        paint = Paint(edge=edge[:3], albedo_beyond=(edge[3],) * 3)
    panel = Panel(
        Pose(turn, np.array(ORIGIN)), extent, radius, paint, tuple(Dent(*d) for d in dents)
    )
    return plain, Surface((panel,))


def replace_lens(rig, focal=None, shift=(0, 0), **size):
    """The rig with another camera: of another focal length, or a part of its image."""
    matrix = rig.camera.camera_matrix.copy()
    matrix[:2, 2] += shift
    distortion = rig.camera.distortion
    if focal:
        matrix[[0, 1], [0, 1]] = focal
        distortion = np.zeros(5)
    camera = dataclasses.replace(rig.camera, camera_matrix=matrix, distortion=distortion, **size)
    return dataclasses.replace(rig, camera=camera)


def flat(**options):
    return Surface((Panel(Pose(Rotation.identity(), np.array([0, 0, 0.6])), WIDE, **options),))


@pytest.mark.parametrize('radius', [0.0, 0.7])
def test_levels_are_those_of_a_plain_renderer(rig, pattern, noiseless, radius):
    plain, surface = both(radius=radius)
    rig = replace_lens(rig, width=64, height=44, shift=(-16, -10))
    image = render(rig, pattern.draw(), surface, noiseless)
    expected = photograph(rig, pattern.draw(), plain, noiseless, fine=5)
    assert expected.max() > 150
    assert np.abs(image - expected).max() < 1
    assert np.abs((image - expected).mean(axis=(0, 1))).max() < 0.05


def test_edges_of_skin_and_paint_cut_pixels_in_parts(rig, pattern, noiseless):
    photometry = dataclasses.replace(noiseless, samples=256)
    corner = replace_lens(rig, width=28, height=20, shift=(-34, -22))
    plain, surface = both(extent=(-0.5, 0.004, -0.004, 0.5), edge=(0.6, 0.8, 0.003, 0.1))
    image = render(corner, pattern.draw(), surface, photometry)
    expected = photograph(corner, pattern.draw(), plain, photometry, fine=16)
    assert (expected == 0).mean() > 0.1
    # Two hundred levels lie between the sides of an edge: its area is right to a fiftieth.
    assert np.abs(image - expected)[1:-1, 1:-1].max() < 4
    assert np.abs((image - expected).mean()) < 0.05


@pytest.mark.parametrize(
    ('dents', 'velocity', 'error'),
    [
        ((), (0.004, 0.001, -0.006), 1.1),
        (DENTS, (0.001, 0.0003, -0.006), 2.0),
    ],
)
def test_motion_is_the_mean_over_the_instants(rig, pattern, noiseless, dents, velocity, error):
    """6 mm towards the skin the fringes move by half a period."""
    plain, surface = both(radius=0.7, dents=dents)
    rig = replace_lens(rig, width=64, height=40, shift=(-16, -12))
    motion = CameraMotion(translation=np.array(velocity))
    image = render(rig, pattern.draw(), surface, noiseless, motion=motion)
    moments = (np.arange(12) + 0.5) / 12 - 0.5
    expected = photograph(
        rig, pattern.draw(), plain, noiseless, fine=3, moments=moments, velocity=velocity
    )
    still = render(rig, pattern.draw(), surface, noiseless)
    assert np.abs(still - expected).max() > 3 * error, 'the motion does not show'
    assert np.abs(image - expected).max() < error
    assert np.abs((image - expected).mean()) < 0.05


def test_a_turning_camera_blurs_as_the_mean_of_its_instants(rig, pattern, noiseless):
    _, surface = both(radius=0.7, dents=())
    rotation = np.array([0.002, -0.008, 0.05])
    renderer = Renderer(rig, pattern.draw(), noiseless)
    blurred = renderer.render(surface, motion=CameraMotion(rotation=rotation))
    moments = (np.arange(24) + 0.5) / 24 - 0.5
    instants = [
        renderer.render(surface.transformed(Pose(Rotation.from_rotvec(t * rotation), np.zeros(3))))
        for t in moments
    ]
    mean = np.mean(instants, axis=0)
    assert np.abs(instants[0] - mean).max() > 5
    assert np.abs(blurred - mean).max() < 1.2


def test_rivets_show_as_dark_rings_of_their_size(rig, noiseless):
    """A groove that is wider than a pixel is dark by its dirt; head and skin are not."""
    rivet = Rivet(0.0, 0.0, radius=0.04, groove=0.0, sigma=0.006, proud=0.0, dirt=0.5)
    white = np.full((100, 160, 3), 255, np.uint8)
    photometry = dataclasses.replace(noiseless, shading=False, ambient=0.0)
    clean = render(rig, white, flat(), photometry).astype(float)
    part = (render(rig, white, flat(rivets=(rivet,)), photometry) / clean)[..., 0]
    x, y, z = np.moveaxis(rig.camera.rays(rig.camera.pixel_grid()), -1, 0) * 0.6
    assert np.all(z == 0.6)
    radius = np.hypot(x, y)
    expected = 1 - 0.5 * np.exp(-0.5 * ((radius - 0.04) / 0.006) ** 2)
    np.testing.assert_allclose(part, expected, atol=0.03)
    assert part.min() < 0.56


def test_a_panel_casts_a_shadow_on_the_one_behind(rig, pattern, noiseless):
    """Half of the skin stands 5 cm nearer: beside it ambient light alone."""
    near = Panel(Pose(Rotation.identity(), np.array([0, 0, 0.55])), (-0.5, 0.0, -0.5, 0.5))
    far = Panel(Pose(Rotation.identity(), np.array([0, 0, 0.6])), (-0.5, 0.5, -0.5, 0.5))
    white = np.full((100, 160, 3), 255, np.uint8)
    # The projector stands on the right: the other way round, the far panel's part is in shadow.
    other = dataclasses.replace(near, extent=(0.0, 0.5, -0.5, 0.5))
    alone = render(rig, white, Surface((far,)), noiseless)
    lit = render(rig, white, Surface((near, far)), noiseless)
    dark = render(rig, white, Surface((other, far)), noiseless)
    rays = rig.camera.rays(rig.camera.pixel_grid())[32]
    x = rays[:, 0] * 0.6
    side = math.copysign(1, rig.projector_centre[0])
    assert side > 0
    assert np.abs(lit[32, x > 0.01].astype(int) - alone[32, x > 0.01]).max() <= 1
    ambient = 250 * 0.8 * 0.02 * np.linalg.norm(rays, axis=1) ** -4
    # Seen from the projector the edge at (0, 0.55) falls on the far plane at this x.
    shadow = -0.05 * rig.projector_centre[0] / (0.55 - rig.projector_centre[2])
    inside = (x > shadow + 0.004) & (x < -0.004)
    assert inside.sum() >= 2
    np.testing.assert_allclose(dark[32, inside, 1], ambient[inside], atol=1)


def test_gloss_is_brightest_where_the_mirror_is(rig, noiseless):
    """The varnish adds light where the normal halves the angle between eye and projector."""
    wide = replace_lens(rig, focal=300.0)
    centre = np.array([0, 0, 0.6])
    half = rig.projector_centre - centre
    half = half / np.linalg.norm(half) - [0, 0, 1]
    mirror, _ = Rotation.align_vectors([-half / np.linalg.norm(half)], [[0, 0, 1]])
    photometry = dataclasses.replace(noiseless, exposure=0.15, ambient=0.0)
    white = np.full((100, 160, 3), 255, np.uint8)

    def level(paint):
        surface = Surface((Panel(Pose(mirror, centre), WIDE, paint=paint),))
        return render(wide, white, surface, photometry)[..., 1].astype(int)

    gain = level(Paint(roughness=0.08)) - level(Paint())
    row, column = np.unravel_index(gain.argmax(), gain.shape)
    assert gain.max() > 30
    assert np.hypot(row - 32.9, column - 46.3) < 6
    assert gain.min() >= 0


def test_a_view_of_nothing_is_black_also_while_it_moves(rig, pattern, noiseless):
    aside = flat().transformed(Pose.from_rpy((0, 0, 0), (5, 0, 0)))
    motion = CameraMotion(translation=np.array([0.001, 0, 0]))
    assert not Renderer(rig, pattern.draw(), noiseless).signal(aside, motion=motion).any()


def test_an_image_that_is_not_the_projectors_is_refused(rig, pattern):
    for image in (pattern.draw()[:-1], pattern.draw()[..., 0], pattern.draw().astype(float)):
        with pytest.raises(ImageError, match='projected image'):
            Renderer(rig, image)
