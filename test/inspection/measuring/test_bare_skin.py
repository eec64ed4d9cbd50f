"""What the skin under a dent is known to, also where little of it is bare."""

from dataclasses import replace

import numpy as np
import pytest
from small_clouds import COLUMNS, ROWS, cloud_of, panel

from ftp_dent_ros.dents.dent import Settings
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.measuring.places.bare_skin import bare_skin
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.panels import find_panels
from ftp_dent_ros.inspection.measuring.skin.waviness import relief_of
from ftp_dent_ros.simulation import waviness

SETTINGS = Settings()


def wavy_cloud():
    return cloud_of(replace(panel(), waves=waviness(3e-4, 0.08, 3)))


def test_a_relief_that_cannot_be_tested_is_unsure_by_all_of_its_amplitude():
    lattice = Lattice.of(wavy_cloud(), SETTINGS)
    across = 0.7 * (np.arange(lattice.valid.shape[1]) - 70) / 500
    waves = np.broadcast_to(3e-4 * np.sin(across * 2 * np.pi / 0.12), lattice.valid.shape)
    bare = np.zeros(lattice.valid.shape, bool)
    tested = relief_of(waves.astype(np.float32), ~bare, lattice, 0.01)
    # A strip as narrow as a hole: none can be cut and held against what was there.
    bare[60:66] = True
    untested = relief_of(waves.astype(np.float32), bare, lattice, 0.01)

    assert tested.uncertainty(0.02) < 0.2 * tested.amplitude
    assert untested.uncertainty(0.02) == pytest.approx(untested.amplitude)
    assert 1e-4 < untested.amplitude < 6e-4


def test_a_contour_without_bare_skin_is_known_to_its_tolerance_only():
    lattice = Lattice.of(cloud_of(panel()), SETTINGS)
    (found,), labels = find_panels(lattice, -lattice.origin, SETTINGS)
    everywhere = np.ones(labels.shape, bool)

    sure = bare_skin(lattice, found, ~everywhere, SETTINGS)
    unsure = bare_skin(lattice, found, everywhere, SETTINGS)

    assert sure.uncertainty(0.0, 0.0, 0.02) < 0.1 * found.tolerance
    assert unsure.uncertainty(0.0, 0.0, 0.02) == pytest.approx(found.tolerance, rel=1e-3)


@pytest.mark.parametrize('hidden', [0.0, 0.3, 0.6])
def test_nothing_on_wavy_skin_is_told_without_its_uncertainty(hidden):
    cloud = wavy_cloud()
    # Holes as dirt leaves them, so that the skin is known in shreds.
    rng = np.random.default_rng(5)
    for row, column in rng.integers(0, (ROWS, COLUMNS), (int(900 * hidden), 2)):
        cloud.points[row : row + 7, column : column + 7] = np.nan
    inspection = inspect(cloud)
    for dent in (*inspection.dents, *inspection.others):
        for name in ('depth', 'length', 'width', 'area', 'volume', 'orientation'):
            estimate = getattr(dent, name)
            assert estimate.is_measured or dent.kind in ('step', 'other')
            assert np.isnan(estimate.value) == np.isnan(estimate.uncertainty)


@pytest.mark.parametrize('seed', [2, 4, 5, 7])
def test_crests_at_the_rim_are_waves_as_all_others_are(seed):
    waves = waviness(1e-4, 0.1, seed)
    found = inspect(cloud_of(replace(panel(), waves=waves), noise=2e-6))
    assert not (*found.dents, *found.others)
    assert found.waviness
