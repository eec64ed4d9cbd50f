import numpy as np
import pytest
from small_scenes import DISTORTED, PATTERN, RIG

from ftp_dent_ros.profilometry.carrier import ReferencePlane, carrier_on
from ftp_dent_ros.profilometry.fourier import analytic_signal, spectrum
from ftp_dent_ros.profilometry.fourier_transform.reference import (
    extend,
    phase_shift,
    reference_phase,
)


@pytest.mark.parametrize('rig', [RIG, DISTORTED], ids=['plain', 'distorted'])
@pytest.mark.parametrize('slope', [0.0, -0.4])
def test_phase_is_that_of_the_column_that_lights_the_plane(rig, slope):
    plane = ReferencePlane(0.65, slope)
    points = np.random.default_rng(0).uniform((-0.15, -0.1, 0), (0.15, 0.1, 0), (50, 3))
    points[:, 2] = plane.depth + slope * points[:, 0]
    rays = rig.camera.rays(rig.camera.project(points))
    columns = rig.projector.project(rig.to_projector(points))[:, 0]
    phase = reference_phase(rig, PATTERN, rays, plane)
    assert phase.dtype == np.float32
    np.testing.assert_allclose(PATTERN.column(phase), columns, atol=1e-4)


@pytest.mark.parametrize('plane', [ReferencePlane(0.4), ReferencePlane(0.65, 2.0)])
def test_fringes_go_on_beyond_the_projector_s_panel(plane):
    phase = reference_phase(RIG, PATTERN, RIG.camera.rays(RIG.camera.pixel_grid(8)), plane)
    columns = PATTERN.column(phase)
    assert np.isfinite(phase).all()
    assert columns.min() < 0 or columns.max() > PATTERN.width


def test_extended_rows_go_straight_on():
    phase = np.array([[1.0, 2.0, 4.0], [5.0, 5.5, 5.0]], np.float32)
    expected = [[-1, 0, 1, 2, 4, 6], [4, 4.5, 5, 5.5, 5, 4.5]]
    np.testing.assert_allclose(extend(phase, 2, 1), expected)
    np.testing.assert_array_equal(extend(phase, 0, 0), phase)


@pytest.mark.parametrize('shift', [0.0, 0.7, -3.0])
def test_shift_between_object_and_reference(shift):
    plane = ReferencePlane(0.65)
    carrier = carrier_on(RIG, PATTERN, plane)
    rays = RIG.camera.rays(RIG.camera.pixel_grid()[::60])
    reference = reference_phase(RIG, PATTERN, rays, plane)
    rows = (60 + 50 * np.cos(reference + np.float32(shift))).astype(np.float32)
    fringes = analytic_signal(spectrum(rows), rows.shape[1], carrier)
    found = phase_shift(fringes, reference, carrier)
    assert found.dtype == np.float32
    # The rows' ends leak, into both alike.
    np.testing.assert_allclose(found[:, 24:-24], shift, atol=0.02)
