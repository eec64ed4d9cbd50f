"""An edge of paint or shadow through fringes, about whose true phase all that is found is its."""

from functools import cache

import cv2
import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.edges_of_light import bridged
from ftp_dent_ros.profilometry.least_squares.fit.even_light import brightness, evened
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import MaskedFit
from ftp_dent_ros.profilometry.least_squares.fit.shadow_fit import ShadowFit
from ftp_dent_ros.profilometry.least_squares.fit.two_sided_fit import OneLight, TwoSidedFit

PERIOD = 11.7
GRID = Grid.for_fringes(640, 360, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)
INNER = slice(8, -8), slice(8, -8)
V, U = np.mgrid[:360, :640].astype(np.float32)
# Across an edge aslant through the middle, pixels.
DISTANCE = ((U - 320) * np.cos(0.44) + (V - 180) * np.sin(0.44)).astype(np.float32)


def paint(dark=0.4):
    return 1 + (dark - 1) * (DISTANCE > 0)


def light(albedo, ambient=0.0, contrast=0.75):
    """Bins of fringes on an albedo, in some other light, behind a lens."""
    fringes = 1 + np.float32(contrast) * np.cos(np.float32(2 * np.pi / PERIOD) * U)
    levels = cv2.GaussianBlur((100 * albedo * (fringes + ambient)).astype(np.float32), (0, 0), 0.7)
    noise = np.random.default_rng(5).normal(0, 0.5, levels.shape)
    return GRID.binned(np.clip(np.round(levels + noise), 0, 255).astype(np.uint8))


def fitted(levels, shadows=False):
    """What one light makes of the phase, and what two sides or a shadow's edge make of it."""
    columns, _ = GRID.bin_positions()
    base = np.broadcast_to(2 * np.pi / PERIOD * columns, GRID.bin_shape).astype(np.float32)
    everywhere, masked = np.ones(GRID.bin_shape, bool), MaskedFit(GRID, WINDOWS)

    def fringes_of(shift):
        phase = base + GRID.at_bins(shift)
        return phase, np.cos(phase), np.sin(phase)

    equations = masked.equations(base, everywhere, None)
    level, modulation, _ = equations.solved(levels)
    bright = brightness(level, np.ones(GRID.shape, bool))
    even = evened(levels, bright, GRID)
    shift = equations.step(even)
    one = OneLight(
        *(levels, even, level, modulation, bright, shift, fringes_of(shift)[1]),
        *(everywhere, everywhere, ~everywhere),
    )
    sides = TwoSidedFit(GRID, WINDOWS, masked, PERIOD / GRID.step)
    if shadows:
        return shift, ShadowFit(GRID, WINDOWS, masked, sides).fitted(one, fringes_of, None, None)
    edges = sides.edges(one, one.cosine)
    return shift, None if edges is None else sides.fitted(one, edges, fringes_of, None)


@cache
def edge(shadow):
    albedo, ambient = (1, np.float32(1.2) * (DISTANCE < 0)) if shadow else (paint(), 0)
    return fitted(light(albedo, ambient, 0.75))


@pytest.mark.parametrize('shadow', [False, True])
def test_an_edge_shifts_no_phase(shadow):
    one, two = edge(shadow)
    assert np.abs(one[INNER]).max() > 0.1
    assert np.abs(two.shift[INNER]).max() < 0.3 * np.abs(one[INNER]).max()
    assert two.shift[INNER].std() < 0.15 * one[INNER].std()


@pytest.mark.parametrize('shadow', [False, True])
def test_what_the_phase_is_off_by_is_within_what_is_said(shadow):
    _, two = edge(shadow)
    near = GRID.at_nodes(two.beside.astype(np.float32))[INNER] > 0.5
    off = two.shift[INNER][near]
    # Of the noise of the pixels, 0.004 rad is left in a window.
    said = np.sqrt(two.variance[INNER][near] + 0.004**2)
    assert 0.3 < np.sqrt(np.mean(np.square(off / said))) < 1.4


@pytest.mark.parametrize('soft', [0.2, 0.25, 0.3], ids='{} fringes'.format)
def test_a_half_shadow_shifts_no_phase(soft):
    share = 1 - np.clip(DISTANCE / (4 * soft * PERIOD) + 0.5, 0, 1)
    one, shadow = fitted(light(0.5, np.float32(2.4) * (3 - 2 * share) * share**2), shadows=True)
    assert np.abs(one[INNER]).max() > 0.08
    assert np.abs(shadow.shift[INNER]).max() < 0.25 * np.abs(one[INNER]).max()
    assert shadow.shift[INNER].std() < 0.2 * one[INNER].std()
    assert not shadow.crossed.any()
    # The sun leaves the fringes as high as they are.
    assert shadow.amplitude[INNER] == pytest.approx(np.median(shadow.amplitude), rel=0.06)


def test_an_edge_of_paint_is_none_of_shadow():
    _, two = fitted(light(paint()), shadows=True)
    assert two.known is None
    assert two.shift == pytest.approx(edge(False)[1].shift, abs=0)


def test_light_of_both_sides_is_one():
    _, two = edge(False)
    apart = GRID.binned(np.abs(DISTANCE)) > 5
    for side in (DISTANCE < 0, DISTANCE > 0):
        here = (GRID.binned(side.astype(np.float32)) == 1) & apart & two.beside
        assert two.even[here].mean() == pytest.approx(two.even[apart].mean(), rel=0.03)


def test_bins_that_the_edge_crosses_do_not_count():
    _, two = edge(False)
    crossing = np.abs(GRID.binned(DISTANCE))[INNER] < 0.5
    assert two.crossed[INNER][crossing].mean() > 0.95
    assert not (two.mask & two.crossed).any()
    assert two.crossed.mean() < 0.03


def test_away_from_the_edge_all_stays():
    one, two = edge(False)
    assert two.shift[:, -10:] == pytest.approx(one[:, -10:], abs=0)
    assert (two.variance[:, -10:] == 0).all()


def test_even_light_and_smooth_light_have_no_edges():
    assert fitted(light(1.0))[1] is None
    assert fitted(light(1 + 0.4 * np.sin(U / 80)))[1] is None


def test_lines_have_no_sides_of_their_own():
    stroke = 1 - 0.7 * (np.abs(DISTANCE) < 0.3 * PERIOD)
    assert fitted(light(stroke))[1] is None


def test_a_field_is_bridged_straight_and_only_where_an_edge_is():
    nodes = np.tile(np.arange(GRID.shape[1], dtype=np.float32), (GRID.shape[0], 1))
    crossed = np.zeros(GRID.bin_shape, bool)
    crossed[20:40, 300:303] = True
    spoilt = nodes.copy()
    middle = 301 // GRID.bins
    spoilt[20:40, middle - 2 : middle + 3] += 1
    mended = bridged(spoilt, crossed, GRID, PERIOD / GRID.step)
    assert mended == pytest.approx(nodes, abs=1e-3)


def test_a_band_wider_than_an_edge_is_not_bridged():
    crossed = np.zeros(GRID.bin_shape, bool)
    crossed[:, 200:400] = True
    nodes = np.random.default_rng(1).normal(size=GRID.shape).astype(np.float32)
    assert (bridged(nodes, crossed, GRID, PERIOD / GRID.step) == nodes).all()
