import numpy as np
import pytest
from small_scenes import DEPTH, PATTERN, Scene, panel

from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.profilometry.carrier import measured_carrier
from ftp_dent_ros.profilometry.fourier_transform.region import lit_region
from ftp_dent_ros.profilometry.stripe import find_stripe, stripe_orders
from ftp_dent_ros.simulation import Paint


def found(scene):
    levels = scene.image.astype(np.float32)
    red = levels[..., 0].copy()
    carrier = measured_carrier(red, scene.rig, PATTERN)
    return find_stripe(levels, lit_region(red, carrier), carrier)


def errors(scene, stripe):
    """Projector columns between the stripe's points and its true middle."""
    rays = scene.rig.camera.rays(np.stack([stripe.column, stripe.row], axis=-1))
    points = rays * scene.surface.intersect(rays)[..., None]
    columns = scene.rig.projector.project(scene.rig.to_projector(points))[..., 0]
    return np.abs(columns - PATTERN.stripe_center_px)


@pytest.mark.parametrize(
    'name', ['flat', 'tilted left', 'cylinder', 'distorted', 'inverted', 'dim and ambient']
)
def test_points_lie_on_the_middle_of_the_stripe(scene, name):
    seen = scene(name)
    stripe = found(seen)
    off = errors(seen, stripe)
    assert np.median(off) < 0.3
    assert off.max() < PATTERN.period_px / 2
    rows = np.nonzero(seen.lit().any(axis=1))[0]
    assert np.ptp(stripe.row) > 0.8 * np.ptp(rows)


@pytest.mark.parametrize(
    'paint',
    [
        Paint((0.3, 0.3, 0.3)),
        Paint((0.25, 0.4, 0.8)),
        Paint((0.8, 0.2, 0.2)),
        Paint((0.8, 0.8, 0.8), (1.0, 0.2, 0.02), (0.7, 0.1, 0.1)),
        Paint((0.15, 0.15, 0.6), (0.6, 1.0, -0.01), (0.8, 0.8, 0.8)),
    ],
    ids=['grey', 'blue', 'red', 'red beyond an edge', 'white beyond an edge'],
)
def test_coloured_paint_is_no_stripe(paint):
    seen = Scene.of(panel(paint=paint))
    assert errors(seen, found(seen)).max() < PATTERN.period_px / 2


def test_clipped_white_fringes_are_no_stripe():
    seen = Scene.of(panel(), exposure=1.4)
    assert (seen.image == 255).any()
    assert errors(seen, found(seen)).max() < PATTERN.period_px / 2


def recoloured(*centres):
    """The pattern with red stripes about some columns instead of its own."""
    pixels = np.repeat(PATTERN.draw()[..., :1], 3, axis=2)
    u = np.arange(PATTERN.width)
    for centre in centres:
        pixels[:, np.abs(u - centre) <= PATTERN.period_px / 2, 1:] = 0
    return pixels


@pytest.mark.parametrize(
    'centres',
    [(), (280, 360)],
    ids=['none', 'two'],
)
def test_no_stripe_or_two_are_refused(centres):
    seen = Scene.of(panel(), projected=recoloured(*centres))
    with pytest.raises(NoStripeError, match='the red stripe is not seen'):
        found(seen)


def test_a_stripe_beside_the_surface_is_refused():
    seen = Scene.of(panel(half=0.06, centre=(0.13, 0.0)))
    assert seen.surface.panels[0].pose.translation[2] == DEPTH
    with pytest.raises(NoStripeError):
        found(seen)


def test_an_empty_region_is_refused(scene):
    seen = scene('flat')
    levels = seen.image.astype(np.float32)
    carrier = measured_carrier(levels[..., 0].copy(), seen.rig, PATTERN)
    with pytest.raises(NoStripeError):
        find_stripe(levels, np.zeros(levels.shape[:2], bool), carrier)


def test_an_image_of_one_row_has_no_stripe(scene):
    seen = scene('flat')
    row = seen.image[:1].astype(np.float32)
    carrier = measured_carrier(seen.image[..., 0].astype(np.float32), seen.rig, PATTERN)
    with pytest.raises(NoStripeError, match='not seen'):
        find_stripe(row, np.ones(row.shape[:2], bool), carrier)


def test_noise_elects_no_stripe():
    """Three rows of faint fringes, in which now and then a fringe lacks green by luck."""
    column = np.arange(170)
    phase = np.tile((2 * np.pi / 8 * (column - 85)).astype(np.float32), (3, 1))
    part = np.zeros(phase.shape, np.int32)
    fringes = (100 + 5 * np.cos(phase)).astype(np.float32)
    in_stripe = np.abs(phase) < np.pi
    elected = 0
    for seed in range(100):
        noise = np.random.default_rng(seed).normal(0, 4, phase.shape).astype(np.float32)
        try:
            elected += bool(stripe_orders(phase, part, fringes, fringes + noise))
        except NoStripeError:
            continue
    assert elected == 0
    other = np.where(in_stripe, 100, fringes).astype(np.float32)
    assert stripe_orders(phase, part, fringes, other) == {0: 0}
