import numpy as np
import pytest
from dirty_fringes import GRID, PERIOD, WINDOWS, dirty_fringes

from ftp_dent_ros.profilometry.least_squares.fit.even_light import brightness, evened
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import MaskedFit

INNER = slice(8, -8), slice(8, -8)
EVERYWHERE = np.ones(GRID.shape, bool)


def test_dirt_feigns_less_of_a_phase_over_its_brightness():
    bins, equations = dirty_fringes()
    level, _, feigned = equations.solved(bins)
    bright = brightness(level, EVERYWHERE)
    even_level, _, left = equations.solved(evened(bins, bright, GRID))
    assert left[INNER].std() < 0.95 * feigned[INNER].std()
    assert even_level[INNER].std() < 0.2 * level[INNER].std()


def test_a_growth_of_the_light_is_taken_off():
    nodes = np.tile(np.linspace(20, 120, GRID.shape[1], dtype=np.float32), (GRID.shape[0], 1))
    even = evened(GRID.at_bins(nodes), brightness(nodes, EVERYWHERE), GRID)
    assert even == pytest.approx(np.median(nodes), rel=1e-3)


def test_what_is_black_or_unknown_is_no_division_by_zero():
    level = np.zeros(GRID.shape, np.float32)
    assert np.isfinite(evened(GRID.at_bins(level), brightness(level, ~EVERYWHERE), GRID)).all()


def test_where_most_crests_are_clipped_the_usual_light_is_that_of_what_is_told():
    columns, _ = GRID.bin_positions()
    phase = np.broadcast_to(2 * np.pi / PERIOD * columns, GRID.bin_shape).astype(np.float32)
    light = 100 + 60 * np.cos(phase)
    # Nothing is seen but in a strip: the level goes to zero away from it.
    mask = np.zeros(GRID.bin_shape, bool)
    mask[:, : GRID.bin_shape[1] // 4] = True
    equations = MaskedFit(GRID, WINDOWS).equations(phase, mask, None)
    level, _, _ = equations.solved(light)
    assert np.median(level) < 10
    bright = brightness(level, equations.told)
    assert equations.told.mean() == pytest.approx(0.25, abs=0.03)
    assert bright[equations.told] == pytest.approx(1.0, abs=0.02)
