from functools import partial

import numpy as np
import pytest

from ftp_dent_ros.profilometry.fourier_transform.estrada import estrada
from ftp_dent_ros.profilometry.unwrapping import unwrap, wrap

ROW, COLUMN = np.mgrid[:60, :200].astype(np.float32)
BUMP = 14 * np.exp(-(((COLUMN - 100) / 30) ** 2) - ((ROW - 30) / 15) ** 2)
PHASE = (0.8 * COLUMN + 0.05 * ROW - BUMP).astype(np.float32)
EVERYWHERE = np.ones(PHASE.shape, bool)
BOTH = pytest.mark.parametrize('integrate', [None, estrada], ids=['itoh', 'estrada'])


def offsets(unwrapped, phase=PHASE):
    """Whole turns between a part and the truth, and how far the rest is off."""
    for part in range(unwrapped.part.max() + 1):
        inside = unwrapped.part == part
        difference = (unwrapped.phase - phase)[inside]
        turns = np.rint(np.median(difference) / (2 * np.pi))
        yield inside, np.abs(difference - 2 * np.pi * turns).max()


def test_wrap_leaves_the_rest_of_whole_turns():
    np.testing.assert_allclose(
        wrap(np.array([0.5, 7.0, -4.0])), [0.5, 7 - 2 * np.pi, 2 * np.pi - 4], atol=1e-6
    )


@BOTH
def test_a_smooth_phase_becomes_continuous(integrate):
    unwrapped = unwrap(wrap(PHASE), EVERYWHERE, integrate=integrate)
    ((inside, off),) = offsets(unwrapped)
    assert inside.all()
    # At the ends of a row Estrada's system still lags behind the slope.
    assert off < (1e-3 if integrate is None else 0.15)
    assert unwrapped.phase.dtype == np.float32


def test_estrada_does_not_lag_behind_a_slope():
    slope = (0.8 * COLUMN).astype(np.float32)
    unwrapped = unwrap(wrap(slope), EVERYWHERE, integrate=partial(estrada, tau=0.6))
    inner = EVERYWHERE & (COLUMN > 15) & (COLUMN < 185)
    off = wrap(unwrapped.phase - slope)[inner]
    assert np.abs(off).max() < 1e-3


def test_estrada_smooths_noise_the_more_the_smaller_tau():
    noise = np.random.default_rng(0).normal(0, 0.3, PHASE.shape)
    left = [
        wrap(estrada(wrap(noise.astype(np.float32)), EVERYWHERE, tau)).std()
        for tau in (1.0, 0.8, 0.5)
    ]
    assert left[0] == pytest.approx(0.3, rel=0.05)
    assert left[0] > left[1] > left[2]


@BOTH
def test_noise_in_some_rows_stays_there(integrate):
    noise = np.random.default_rng(0).normal(0, 0.05, PHASE.shape)
    noise[20:23] = np.random.default_rng(1).uniform(-np.pi, np.pi, (3, 200))
    unwrapped = unwrap(wrap((PHASE + noise).astype(np.float32)), EVERYWHERE, integrate=integrate)
    clean = np.ones(60, bool)
    clean[20:23] = False
    for label in np.unique(unwrapped.part[clean]):
        inside = (unwrapped.part == label) & clean[:, None]
        turns = np.rint((unwrapped.phase - PHASE)[inside] / (2 * np.pi))
        assert len(np.unique(turns)) == 1


@BOTH
def test_parts_that_nothing_ties_have_labels_of_their_own(integrate):
    region = EVERYWHERE.copy()
    region[:, 90:100] = False
    region[28:32] = False
    unwrapped = unwrap(wrap(PHASE), region, integrate=integrate)
    assert set(np.unique(unwrapped.part)) == {-1, 0, 1, 2, 3}
    assert ((unwrapped.part < 0) == ~region).all()
    assert not unwrapped.phase[~region].any()
    for inside, off in offsets(unwrapped):
        assert off < (1e-3 if integrate is None else 0.15)
        assert inside[0].any() != inside[-1].any()


@BOTH
def test_the_way_round_a_hole_ties_both_sides(integrate):
    region = EVERYWHERE.copy()
    region[10:50, 60:140] = False
    unwrapped = unwrap(wrap(PHASE), region, integrate=integrate)
    ((inside, off),) = offsets(unwrapped)
    assert (inside == region).all()
    assert off < 0.15


def test_a_jump_between_rows_ties_nothing():
    stepped = PHASE + np.where(ROW < 30, 0, np.float32(2.2))
    assert unwrap(wrap(stepped), EVERYWHERE, jump=np.pi / 2).part.max() == 1
    assert unwrap(wrap(PHASE), EVERYWHERE, jump=np.pi / 2).part.max() == 0


def test_inclined_fringes_are_no_jump():
    inclined = (0.8 * COLUMN + 1.9 * ROW).astype(np.float32)
    unwrapped = unwrap(wrap(inclined), EVERYWHERE, jump=np.pi / 2)
    assert unwrapped.part.max() == 0


def test_an_empty_region_has_no_part():
    unwrapped = unwrap(wrap(PHASE), ~EVERYWHERE)
    assert (unwrapped.part == -1).all()
    assert not unwrapped.phase.any()
