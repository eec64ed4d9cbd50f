import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.correction import Correction

PERIOD = 10.4
GRID = Grid.for_fringes(640, 360, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)
INNER = slice(8, -8), slice(8, -8)
AMPLITUDE = np.float32(60)
PHASE = np.broadcast_to(2 * np.pi / PERIOD * GRID.bin_positions()[0], GRID.bin_shape)
FRINGES = np.cos(PHASE).astype(np.float32), np.sin(PHASE).astype(np.float32)


def corrected(rest, mask=None, coded=False):
    mask = np.ones(rest.shape, bool) if mask is None else mask
    modulation = np.full(GRID.shape, AMPLITUDE)
    rest = rest.astype(np.float32)
    return Correction.of(
        *(rest, rest / AMPLITUDE, FRINGES, modulation, mask, 0.0, coded),
        *(GRID, WINDOWS, 1.0),
    )


@pytest.mark.parametrize('coded', [False, True])
def test_a_shift_of_the_fringes_is_the_step(coded):
    rest = AMPLITUDE * (np.cos(PHASE + 0.05) - FRINGES[0])
    found = corrected(rest, coded=coded)
    assert found.step[INNER] == pytest.approx(0.05, abs=1e-3)
    assert found.along[INNER] == pytest.approx(60 * np.cos(0.05), rel=1e-3)
    assert found.support[INNER] == pytest.approx(1, abs=0.01)


def test_albedo_as_fine_as_the_fringes_leaves_their_double_frequency():
    albedo = 0.04 * FRINGES[1]
    found = corrected(AMPLITUDE * albedo * (1 + FRINGES[0]))
    assert found.step[INNER] == pytest.approx(-0.04, abs=2e-3)
    assert found.texture[INNER].mean() == pytest.approx(0.02, abs=1e-3)


def test_bins_that_are_masked_out_do_not_count():
    rest = AMPLITUDE * (np.cos(PHASE + 0.05) - FRINGES[0])
    mask = np.ones(rest.shape, bool)
    mask[:, ::7] = False
    rest[:, ::7] = 1e4
    assert corrected(rest, mask).step[INNER] == pytest.approx(0.05, abs=0.01)


def test_a_limit_is_that_of_every_value_and_of_its_type():
    values = np.array([-1, 0.5, 2, np.nan], np.float32)
    limited = at_least(values, 1)
    assert limited.dtype == np.float32
    np.testing.assert_array_equal(limited, np.float32([1, 1, 2, np.nan]))
