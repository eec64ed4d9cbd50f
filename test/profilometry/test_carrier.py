from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_scenes import DISTORTED, INVERTED, PATTERN, RIG, lens, panel

from ftp_dent_ros.errors import RigError
from ftp_dent_ros.profilometry.carrier import (
    Carrier,
    ReferencePlane,
    carrier_on,
    measured_carrier,
    plane_through,
)
from ftp_dent_ros.profilometry.fourier_transform.reference import reference_phase
from ftp_dent_ros.rig.rig import Rig


def fringes(period, size=(48, 640)):
    u = np.arange(size[1])
    return np.broadcast_to(100 + 80 * np.cos(2 * np.pi * u / period), size).astype(np.float32)


def test_band_is_half_the_carrier_to_either_side():
    carrier = Carrier(0.125)
    assert carrier.period == 8
    assert carrier.radius == 0.0625


@pytest.mark.parametrize('depth', [0.3, 0.65, 2.0])
def test_parallel_views_show_the_same_period_at_any_depth(depth):
    parallel = Rig(RIG.camera, RIG.projector, np.eye(3), np.array([-0.1, 0.0, 0.0]))
    carrier = carrier_on(parallel, PATTERN, ReferencePlane(depth))
    assert carrier.period == pytest.approx(PATTERN.period_px * 900 / 940)
    assert carrier.sign == 1


@pytest.mark.parametrize('rig', [RIG, DISTORTED, INVERTED], ids=['plain', 'distorted', 'inverted'])
@pytest.mark.parametrize('plane', [ReferencePlane(0.65), ReferencePlane(0.65, 0.3)])
def test_carrier_is_the_reference_s_frequency_at_the_optical_axis(rig, plane):
    carrier = carrier_on(rig, PATTERN, plane)
    # Where the camera sees what the middle of the projector's axis lights.
    ends = np.array([[318.5, 237.5], [326.5, 237.5]])
    phase = reference_phase(rig, PATTERN, rig.camera.rays(ends), plane)
    frequency = (phase[1] - phase[0]) / (2 * np.pi * 8)
    assert carrier.sign == np.sign(frequency)
    assert carrier.frequency == pytest.approx(abs(frequency), rel=0.03)


def test_a_projector_on_its_side_is_refused():
    turned = replace(RIG, rotation=Rotation.from_euler('z', np.pi / 2).as_matrix() @ RIG.rotation)
    with pytest.raises(RigError, match='mount the projector upright'):
        carrier_on(turned, PATTERN, ReferencePlane(0.65))


def test_fringes_finer_than_the_pixels_are_refused():
    with pytest.raises(RigError, match='longer period'):
        carrier_on(replace(RIG, camera=lens(300.0)), PATTERN, ReferencePlane(0.65))


def on_stripe(tilt):
    """Points where the stripe lies on a panel."""
    skin = panel(tilt=(0.0, tilt), half=0.3, dents=())
    rays = RIG.camera.rays(RIG.camera.pixel_grid(4))
    scale, _, _ = skin.hit_bare(np.zeros(3), rays.reshape(-1, 3))
    points = rays * scale.reshape(rays.shape[:2])[..., None]
    column = RIG.projector.project(RIG.to_projector(points))[..., 0]
    middle = np.abs(column - PATTERN.stripe_center_px).argmin(axis=1)
    return points[np.arange(len(points)), middle]


def test_reference_is_square_to_the_camera_where_that_will_do():
    points = on_stripe(0.05)
    seen = Carrier(1.1 * carrier_on(RIG, PATTERN, ReferencePlane(0.65)).frequency)
    plane = plane_through(RIG, PATTERN, points, seen)
    assert plane == ReferencePlane(np.median(points[:, 2]))


@pytest.mark.parametrize('slope', [-0.9, 0.9])
def test_reference_turns_with_a_surface_that_leaves_the_band(slope):
    points = on_stripe(-np.arctan(slope))
    seen = carrier_on(RIG, PATTERN, ReferencePlane(0.65, slope))
    plane = plane_through(RIG, PATTERN, points, seen)
    if plane.slope:
        assert np.sign(plane.slope) == np.sign(slope)
    turned = carrier_on(RIG, PATTERN, plane)
    assert turned.frequency == pytest.approx(seen.frequency, rel=0.15)
    middle = np.median(points, axis=0)
    assert plane.depth + plane.slope * middle[0] == pytest.approx(middle[2])


@pytest.mark.parametrize('period', [5.3, 7.0, 8.0, 11.7])
def test_carrier_is_measured_in_the_image(period):
    carrier = measured_carrier(fringes(period), RIG, PATTERN)
    assert carrier.period == pytest.approx(period, rel=0.01)
    assert carrier.sign == 1


def test_sign_of_the_carrier_comes_from_the_rig():
    assert measured_carrier(fringes(8.0), INVERTED, PATTERN).sign == -1


def test_a_bright_object_does_not_pass_for_the_carrier():
    red = fringes(8.0) * np.linspace(0.1, 1, 640, dtype=np.float32)
    red[:, 200:330] += 120
    assert measured_carrier(red, RIG, PATTERN).period == pytest.approx(8.0, rel=0.01)


@pytest.mark.parametrize('level', [0, 77, 255])
def test_an_even_image_leaves_what_the_rig_suggests(level):
    carrier = measured_carrier(np.full((20, 640), level, np.float32), RIG, PATTERN)
    assert carrier.period == pytest.approx(8.0, rel=0.2)
