"""How far a surface covers the bins at its rim, and where that is not to be told."""

import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.fit.surface_mask import astray, rim_cover

PERIOD, COLUMNS, FIRST = 5.0, 80, 6  # of the fringes, bins; the first bin that is whole


@pytest.fixture
def fringes():
    u = np.arange(COLUMNS)
    return np.tile(40 * np.cos(2 * np.pi * u / PERIOD), (12, 1)).astype(np.float32)


@pytest.fixture
def body():
    body = np.zeros((12, COLUMNS), bool)
    body[FIRST:] = True
    return body


def of_rim(fringes, body, beyond):
    """Share of the bins' outer row where it covers 0.4 of them, and `beyond` the rest."""
    share = np.where(body, 1, 0).astype(np.float32)
    share[FIRST - 1] = 0.4
    levels = 100 + share * fringes + (1 - share) * beyond
    everywhere = np.ones_like(body)
    return rim_cover(levels, fringes, body, everywhere, PERIOD)[FIRST - 1, 10:-10]


def test_a_surface_that_ends_in_the_dark_covers_its_share(fringes, body):
    assert of_rim(fringes, body, np.float32(-50)) == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize('turn', [0.25, 1.0, 2.5])
def test_beside_another_surface_nothing_is_said_to_be_covered(fringes, body, turn):
    # Its fringes look like those of this one but for their phase.
    u = np.arange(COLUMNS)
    others = (35 * np.cos(2 * np.pi * u / PERIOD + turn)).astype(np.float32)
    assert not of_rim(fringes, body, others).any()


def test_below_a_surface_the_same_holds(fringes, body):
    flipped = body[::-1].copy()
    others = np.where(flipped, fringes, np.roll(fringes, 1, axis=1))
    covered = rim_cover(others, fringes, flipped, np.ones_like(body), PERIOD)
    assert not covered[~flipped].any()
    dark = np.where(flipped, fringes, 0)
    dark[FIRST] = 0.4 * fringes[FIRST]
    covered = rim_cover(dark, fringes, flipped, np.ones_like(body), PERIOD)
    assert covered[FIRST, 10:-10] == pytest.approx(0.4, abs=0.03)


def test_what_misfits_by_more_than_noise_is_told_with_the_fringe_around_it(body):
    misfit = np.random.default_rng(1).normal(0, 0.01, body.shape).astype(np.float32)
    assert astray(misfit, body, body, PERIOD).mean() < 0.01
    # A tenth of the amplitude is too much here; beyond the surface it tells nothing.
    misfit[8, 40] = 0.1
    misfit[FIRST - 2] = 1
    found = astray(np.clip(misfit, -0.03, None), body, body, PERIOD)
    np.testing.assert_array_equal(np.argwhere(found), [[8, u] for u in range(37, 44)])
