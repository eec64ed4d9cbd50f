import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import noise_through
from ftp_dent_ros.profilometry.least_squares.noise.other_light import OtherLight
from ftp_dent_ros.profilometry.least_squares.noise.response import Response

PERIOD = 9.0
GRID = Grid.for_fringes(800, 450, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)
OTHER_LIGHT = OtherLight(WINDOWS, noise_through(GRID, WINDOWS, Response.of(PERIOD, GRID, fits=2)))
ROWS, COLUMNS = np.indices(GRID.shape).astype(np.float32)
FRINGES = COLUMNS * np.float32(GRID.pitch[0] / PERIOD)
BRIGHT = np.full(GRID.shape, 80, np.float32)
INNER = slice(20, -20), slice(20, -20)
NOISE = 0.01  # variance of a bin, in amplitudes


def variance(level, modulation, pixels=1e-6):
    fields = (np.asarray(each, np.float32) for each in (level, modulation))
    everywhere = np.ones(GRID.shape, bool)
    return OTHER_LIGHT.variance(*fields, np.full(GRID.shape, pixels, np.float32), everywhere)


@pytest.mark.parametrize('beat', [3.0, 5.0, 6.0])
def test_other_fringes_disturb_the_phase_as_much_as_the_contrast(beat):
    part = 0.06
    modulation = BRIGHT * (1 + part * np.cos(2 * np.pi * FRINGES / beat))
    told = variance(1.1 * BRIGHT, modulation)[INNER]
    assert np.median(told) == pytest.approx(part**2 / 2, rel=0.35)


def test_the_pixels_noise_is_not_other_light():
    rng = np.random.default_rng(3)
    fields = []
    for gain in (1, np.sqrt(2)):
        bins = np.sqrt(NOISE) * gain * rng.standard_normal(GRID.bin_shape, np.float32)
        fields.append(BRIGHT * (1 + WINDOWS.gaussian(GRID.at_nodes(bins))))
    through = np.var(fields[1] / BRIGHT)
    assert np.median(variance(*fields, pixels=NOISE)[INNER]) < 0.1 * through


def test_paint_and_shading_change_no_contrast():
    paint = 1 - 0.5 * (COLUMNS.max() / 2 < COLUMNS)
    shading = 1 - 0.3 * (ROWS / ROWS.max()) ** 2
    light = BRIGHT * paint * shading
    assert variance(1.1 * light, light).max() < 1e-8


def test_a_slope_in_daylight_is_no_other_light():
    slope = 1 + 0.05 * np.cos(2 * np.pi * FRINGES / 6)
    assert variance(BRIGHT * (slope + 2), BRIGHT * slope).max() < 1e-5
    # The same in the projector's light alone is.
    assert np.median(variance(1.1 * BRIGHT, BRIGHT * slope)[INNER]) > 5e-4


def test_a_surface_of_a_few_nodes_tells_nothing():
    few = np.zeros(GRID.shape, bool)
    few[5:7, 5:7] = True
    assert not OTHER_LIGHT.variance(BRIGHT, BRIGHT, BRIGHT, few).any()


def test_light_from_elsewhere_changes_the_level_alone():
    flicker = 1 + 0.5 * np.cos(ROWS / 3)
    edge = COLUMNS > 80
    for ambient in (flicker, edge):
        assert variance(BRIGHT * (1.1 + ambient), BRIGHT).max() < 1e-8
