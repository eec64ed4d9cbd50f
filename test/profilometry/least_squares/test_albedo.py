import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import MaskedFit
from ftp_dent_ros.profilometry.least_squares.noise.albedo import (
    Feigned,
    slope_along_u,
    without_trend,
)
from ftp_dent_ros.profilometry.least_squares.noise.bands import split
from ftp_dent_ros.simulation import Dirt

PERIOD = 10.4
GRID = Grid.for_fringes(640, 360, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)
INNER = slice(8, -8)


def grain(seed, size):
    """Smooth noise at the nodes."""
    field = WINDOWS.gaussian(np.random.default_rng(seed).standard_normal(GRID.shape, np.float32))
    return field * np.float32(size / field.std())


def factors(values, texture, slope):
    feigned = Feigned.of(values, texture, slope, WINDOWS, 2)
    means = feigned.on_texture, feigned.on_slope, feigned.explained
    return [float(np.median(each)) for each in means]


def finest(field):
    return split(field, WINDOWS)[0][0][INNER, INNER]


def test_the_contrast_tells_what_dirt_feigns():
    # A plane under dirt, fitted about its true phase: the step is all the dirt's.
    v, u = np.mgrid[:360, :640].astype(np.float32)
    scale = np.float32(4e-4)  # metres a pixel
    light = Dirt(0.25, seed=3).factor(u * scale, v * scale)
    light *= 1 + np.float32(0.7) * np.cos(np.float32(2 * np.pi / PERIOD) * u)
    bins = GRID.binned(np.round(100 * light).astype(np.uint8))
    columns, _ = GRID.bin_positions()
    phase = np.broadcast_to(2 * np.pi / PERIOD * columns, bins.shape).astype(np.float32)
    everywhere = np.ones(bins.shape, bool)
    level, modulation, step = (
        MaskedFit(GRID, WINDOWS).equations(phase, everywhere, None).solved(bins)
    )
    slope = slope_along_u(np.log(modulation / level), PERIOD / GRID.pitch[0])
    feigned, told = finest(step), finest(without_trend(slope, WINDOWS))
    assert np.corrcoef(feigned.ravel(), told.ravel())[0, 1] > 0.6


def test_both_signs_are_told_apart():
    texture, slope = grain(1, 0.02), grain(2, 0.03)
    on_texture, on_slope, explained = factors(0.9 * slope - 3 * texture, texture, slope)
    assert on_texture == pytest.approx(3, rel=0.1)
    assert on_slope == pytest.approx(0.9, rel=0.1)
    assert explained > 0.95


def test_a_contrast_that_no_texture_bears_out_is_no_albedo():
    slope = grain(3, 0.03)
    _, on_slope, explained = factors(slope, grain(4, 0.02), slope)
    assert on_slope < 0.05
    assert explained < 0.1


def test_a_surface_is_no_albedo():
    _, _, explained = factors(grain(5, 0.1), grain(6, 0.02), grain(7, 0.03))
    assert explained < 0.05


def test_a_slope_is_over_the_phase_of_the_fringes():
    nodes = np.tile(np.arange(12, dtype=np.float32), (4, 1))
    assert slope_along_u(nodes, 2 * np.pi)[:, 1:-1] == pytest.approx(1)
