from __future__ import annotations

import numpy as np
import pytest

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.code.contrast_code import ContrastSteps
from ftp_dent_ros.profilometry.least_squares.code.expected_steps import ExpectedSteps
from ftp_dent_ros.profilometry.least_squares.fringe_orders.doubted_pieces import (
    drop_unsure,
    settle,
)
from ftp_dent_ros.profilometry.least_squares.fringe_orders.misfits import around
from ftp_dent_ros.profilometry.least_squares.fringe_orders.pieces import continuous

PATTERN = Pattern(1280, 800, 10.0, 640.0, code='contrast')
EXPECTED = ExpectedSteps.of(PATTERN)
ROWS, FRINGES, HIGH = 80, 60, 5


def steps_of(order, noise):
    """Steps of an order as seen through noise of a standard deviation, that is known of each."""
    place = np.arange(FRINGES) + order - EXPECTED.first
    noise = np.broadcast_to(np.float32(noise), (ROWS, FRINGES))
    scatter = np.random.default_rng(1).standard_normal((ROWS, FRINGES))
    seen = (EXPECTED.steps[place] + noise * scatter).astype(np.float32)
    return ContrastSteps(0, 0, seen, np.float32(1) / np.square(noise + np.float32(0.02)))


@pytest.fixture
def clean():
    return steps_of(-30, 0.02)


def test_a_fringe_on_an_edge_is_no_other_orders(clean):
    clean.step[:, 20] += 0.4
    clean.step[:, 21] -= 0.4
    assert clean.misfit(EXPECTED, -30, 1.0)[:, 20:22].min() > 0.5
    assert clean.misfit_but_for_edges(EXPECTED, -30, 1.0)[:, 20:22].max() == 0
    clean.step[:, 22] += 0.4
    assert clean.misfit_but_for_edges(EXPECTED, -30, 1.0)[:, 20:23].min() > 0.5


def test_another_order_keeps_its_misfit(clean):
    assert clean.misfit(EXPECTED, -30, 1.0).mean() < 0.02
    for order in (-31, -29, -20, 10):
        assert clean.misfit(EXPECTED, order, 1.0).mean() > 0.3


def settled(steps, piece, orders, in_light=False):
    choice = np.zeros((ROWS, FRINGES), np.intp)
    choice[piece] = -1
    misfit = around(steps.misfit(EXPECTED, orders[0], 1.0), steps.weight > 0, HIGH)
    fits = np.full(choice.shape, in_light)
    settle(steps, EXPECTED, orders, choice, misfit, fits, HIGH)
    return choice[piece]


def test_a_piece_whose_steps_together_tell_the_order_beside_is_its():
    # Single steps say nothing, their mean over 20 rows does.
    noise = np.full((ROWS, FRINGES), 0.03)
    piece = slice(30, 50), slice(20, 32)
    noise[piece] = 0.3
    assert (settled(steps_of(-30, noise), piece, [-30]) == 0).all()


def test_a_small_piece_that_misfits_by_its_noise_alone_is_of_what_lies_around():
    noise = np.full((ROWS, FRINGES), 0.05)
    piece = slice(30, 36), slice(20, 25)
    noise[piece] = 0.25
    assert (settled(steps_of(-30, noise), piece, [-30]) == 0).all()


def test_a_small_piece_of_another_order_stays_without_one_if_not_for_its_light(clean):
    piece = slice(30, 50), slice(20, 26)
    clean.step[piece] = steps_of(-27, 0.02).step[piece]
    assert (settled(clean, piece, [-30]) == -1).all()
    assert (settled(clean, piece, [-30], in_light=True) == 0).all()


def test_where_noise_hides_another_order_more_rows_show_it():
    noisy = steps_of(-30, 0.25)
    noisy.step[:, 30:] = steps_of(-27, 0.25).step[:, 30:]
    some = noisy.averaged(15)
    single, mean = (each.misfit(EXPECTED, -30, 1.0) for each in (noisy, some))
    assert single[:, :30].mean() > 0.35
    assert mean[10:-10, :30].mean() < 0.1
    assert mean[10:-10, 30:].mean() > 0.4


def plane(fringe=0.0):
    """Region and phase of a plane; of some rows of it so many fringes nearer."""
    row, column = np.mgrid[:40, :60]
    phase = 3.7 * column + 0.1 * row
    phase[20:] += 2 * np.pi * fringe
    return np.ones(phase.shape, bool), phase.astype(np.float32)


def test_a_surface_does_not_go_on_over_a_leap_of_its_phase():
    assert len(continuous(*plane())) == 1
    upper, lower = continuous(*plane(1))
    assert upper[:18].all() and not upper[20:].any()
    assert lower[22:].all() and not lower[:20].any()


def test_a_surface_does_not_go_on_through_a_neck():
    region, phase = plane()
    region[20, :30] = region[20, 32:] = False
    upper, lower = continuous(region, phase)
    assert not (upper & lower).any()
    assert (upper | lower).sum() > 0.97 * region.sum()
    region, phase = plane()
    region[0, ::3] = False
    assert (continuous(region, phase)[0] == region).all()


def test_an_order_that_a_piece_does_not_tell_for_sure_is_taken_from_it(clean):
    sure, unsure = slice(0, 20), slice(40, 60)
    clean.step[sure] = steps_of(-27, 0.02).step[sure]
    choice = np.zeros((ROWS, FRINGES), np.intp)
    choice[sure] = 1
    choice[unsure, 20:25] = 1
    drop_unsure(clean, EXPECTED, [-30, -27], choice)
    assert (choice[sure] == 1).all()
    assert (choice[unsure, 20:25] == -1).all()
    assert (choice[unsure, :20] == 0).all()
