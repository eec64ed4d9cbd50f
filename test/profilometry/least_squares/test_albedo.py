import numpy as np
import pytest
from dirty_fringes import GRID, WINDOWS, dirty_fringes

from ftp_dent_ros.profilometry.least_squares.noise.albedo import (
    Feigned,
    slope_along_u,
    without_trend,
)
from ftp_dent_ros.profilometry.least_squares.noise.bands import split

INNER = slice(8, -8)


def grain(seed, size):
    """Smooth noise at the nodes."""
    field = WINDOWS.gaussian(np.random.default_rng(seed).standard_normal(GRID.shape, np.float32))
    return field * np.float32(size / field.std())


def factors(values, texture, slope, contrast=1.0):
    logarithm = np.full(GRID.shape, np.log(contrast), np.float32)
    feigned = Feigned.of(values, texture, slope, logarithm, WINDOWS, 2)
    means = feigned.on_texture, feigned.on_slope, feigned.explained
    return [float(np.median(each)) for each in means]


def finest(field):
    return split(field, WINDOWS)[0][0][INNER, INNER]


def test_the_contrast_tells_what_dirt_feigns():
    bins, equations = dirty_fringes()
    level, modulation, step = equations.solved(bins)
    slope = slope_along_u(without_trend(np.log(modulation / level), WINDOWS))
    feigned, told = finest(step), finest(slope)
    assert np.corrcoef(feigned.ravel(), told.ravel())[0, 1] > 0.6


def test_both_signs_are_told_apart():
    texture, slope = grain(1, 0.02), grain(2, 0.03)
    on_texture, on_slope, explained = factors(0.9 * slope - 3 * texture, texture, slope, 0.2)
    assert on_texture == pytest.approx(3, rel=0.1)
    assert on_slope == pytest.approx(0.9, rel=0.1)
    assert explained > 0.95


def test_of_weak_fringes_the_contrast_alone_tells():
    slope = grain(3, 0.03)
    _, on_slope, explained = factors(0.8 * slope, grain(4, 0.02), slope, contrast=0.2)
    assert on_slope == pytest.approx(0.8, rel=0.1)
    assert explained > 0.9


def test_of_strong_fringes_texture_tells_more():
    slope = grain(3, 0.03)
    _, on_slope, _ = factors(0.8 * slope, grain(4, 0.02), slope)
    assert on_slope == pytest.approx(1 / 3)


def test_a_surface_is_no_albedo():
    _, _, explained = factors(grain(5, 0.1), grain(6, 0.02), grain(7, 0.03))
    assert explained < 0.05


def test_a_slope_is_that_between_neighbours():
    nodes = np.tile(np.arange(12, dtype=np.float32), (4, 1))
    assert slope_along_u(nodes)[:, 1:-1] == pytest.approx(1)
