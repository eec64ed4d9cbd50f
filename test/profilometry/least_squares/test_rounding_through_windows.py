import numpy as np
import pytest

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import rounding_through

PERIOD = 9.7
GRID = Grid.for_fringes(1280, 720, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)


def through(*shifts):
    known = np.array(shifts, np.float32)[None]
    return rounding_through(np.stack([known, 0 * known]), GRID, WINDOWS, PERIOD)


def test_what_all_fringes_have_alike_no_average_lessens():
    *bands, below = through(*[2e-3] * 100)
    assert below == pytest.approx(4e-6, rel=1e-3)
    assert sum(bands) < 1e-8


def test_what_differs_from_fringe_to_fringe_is_of_the_finer_bands():
    *bands, below = through(*[2e-3, -2e-3, 0.0] * 40)
    assert below < 0.01 * sum(bands)
    assert sum(bands[:2]) > 0.99 * sum(bands)
    # Of what is linear between fringes' middles less is left than of the fringes.
    assert 0.5 < sum(bands) / (8e-6 / 3) < 1


def test_bands_and_what_is_below_make_up_the_whole():
    shifts = Pattern(1280, 720, 7.3, 689.0).rounding_shifts
    *bands, below = rounding_through(shifts, GRID, WINDOWS, PERIOD)
    whole = np.square(shifts).mean(axis=(1, 2)).sum()
    assert 0.4 * whole < sum(bands) + below < whole
    # Of these fringes, whose rounding differs, hardly a tenth is that of all.
    assert below < 0.1 * whole
