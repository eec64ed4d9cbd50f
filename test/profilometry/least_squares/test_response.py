import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import WIDTH, Windows
from ftp_dent_ros.profilometry.least_squares.noise.response import Response

GRID = Grid.for_fringes(900, 720, 11.7)


def gain_of(step, wavelength):
    """What a step leaves of a wave, by its length in pixels."""
    column, _ = GRID.node_positions()
    wave = np.tile(np.cos(2 * np.pi * column / wavelength), (80, 1)).astype(np.float32)
    inner = slice(30, -30), slice(30, -30)
    return float((step(wave)[inner] * wave[inner]).sum() / np.square(wave[inner]).sum())


@pytest.mark.parametrize('fits', [2, 4])
def test_half_of_a_wave_is_left_at_the_wavelength_told(fits):
    response = Response.of(11.7, GRID, fits)
    wavelength = float(response.wavelength(np.float32(0)))
    assert gain_of(response.left_out, wavelength) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize('fits', [2, 4])
def test_what_is_put_back_makes_it_shorter(fits):
    response = Response.of(11.7, GRID, fits)
    none, half, all_of_it = response.wavelength(np.array([0, 0.5, 1], np.float32))
    assert none > half > all_of_it
    # Putting all back is as many fits once more.
    twice = float(Response.of(11.7, GRID, 2 * fits).wavelength(np.float32(0)))
    assert all_of_it == pytest.approx(twice, rel=1e-4)


def test_two_fits_and_a_flat_top_leave_out_as_four_fits():
    response, windows = Response.of(11.7, GRID, 4), Windows.for_fringes(11.7, GRID)
    whole = Windows(*(WIDTH * 11.7 / pitch for pitch in GRID.pitch))

    def left_out(field):
        for _ in range(2):
            field = field - whole.gaussian(field)
        return field - whole.flat_top(field)

    assert windows.sigma_u < whole.sigma_u
    for wavelength in (20, 30, 50):
        assert gain_of(response.left_out, wavelength) == pytest.approx(
            gain_of(left_out, wavelength), abs=0.01
        )
