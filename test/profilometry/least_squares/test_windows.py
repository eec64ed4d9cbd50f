import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import WIDTH, Windows

WINDOWS = Windows(1.4, 1.1)


def waves(wavelength, shape=(120, 160)):
    return np.tile(np.cos(2 * np.pi * np.arange(shape[1]) / wavelength), (shape[0], 1)).astype(
        np.float32
    )


def inner(field, rim=30):
    return field[rim:-rim, rim:-rim]


@pytest.mark.parametrize('period', [5.0, 7.7, 11.7, 16.0])
def test_with_bins_and_nodes_a_window_is_half_a_fringe_wide(period):
    grid = Grid.for_fringes(640, 480, period)
    windows = Windows.for_fringes(period, grid)
    for sigma, pitch, variance in zip(
        (windows.sigma_u, windows.sigma_v), grid.pitch, grid.node_variance, strict=True
    ):
        assert (sigma * pitch) ** 2 + variance == pytest.approx((WIDTH * period) ** 2)


def test_a_gaussian_leaves_of_a_wave_what_it_should():
    for wavelength in (6, 10, 20):
        expected = np.exp(-2 * (np.pi * WINDOWS.sigma_u / wavelength) ** 2)
        seen = waves(wavelength)
        np.testing.assert_allclose(
            inner(WINDOWS.gaussian(seen)), expected * inner(seen), atol=2e-3
        )


def test_a_flat_top_leaves_cubics_as_they_are():
    row, column = (each / 100 for each in np.indices((120, 160)))
    cubic = (1 + row - column + row**2 - 2 * row * column + column**3 - row**3).astype(np.float32)
    np.testing.assert_allclose(inner(WINDOWS.flat_top(cubic)), inner(cubic), atol=5e-4)
    np.testing.assert_allclose(inner(WINDOWS.wide_flat_top(cubic, 2.8)), inner(cubic), atol=5e-3)


@pytest.mark.parametrize('scale', [1.4, 2.8, 5.6])
def test_wide_windows_are_as_wide_on_a_coarser_grid(scale):
    wavelength = 14 * scale
    seen = waves(wavelength)
    expected = np.exp(-2 * (np.pi * scale * WINDOWS.sigma_u / wavelength) ** 2)
    np.testing.assert_allclose(
        inner(WINDOWS.wide(seen, scale), 45), expected * inner(seen, 45), atol=0.015
    )
