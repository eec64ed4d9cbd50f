import numpy as np
import pytest

from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.profilometry.fourier_transform.absolute_phase import fringe_order

TURN = 2 * np.pi
ROW, COLUMN = np.mgrid[:40, :120]
# Zero along a stripe that leans.
TRUE = (0.7 * (COLUMN - 50.3 - 0.1 * ROW)).astype(np.float32)
ROWS = np.arange(40)
STRIPE = 50.3 + 0.1 * ROWS


def test_the_stripe_gives_the_whole_turns():
    relative = TRUE - np.float32(7 * TURN)
    turns = fringe_order(relative, np.zeros(TRUE.shape, np.int32), ROWS, STRIPE)
    np.testing.assert_allclose(turns, 7 * TURN)


def test_an_error_of_the_stripe_below_half_a_fringe_changes_nothing():
    column = STRIPE + np.random.default_rng(0).uniform(-4, 4, 40)
    turns = fringe_order(TRUE, np.zeros(TRUE.shape, np.int32), ROWS, column)
    np.testing.assert_array_equal(turns, 0)


def test_a_few_rows_that_err_are_outvoted():
    column = STRIPE.copy()
    column[::4] += TURN / 0.7
    turns = fringe_order(TRUE, np.zeros(TRUE.shape, np.int32), ROWS, column)
    np.testing.assert_array_equal(turns, 0)


def test_parts_get_their_own_order_or_none():
    part = np.where(ROW < 20, 0, 1).astype(np.int32)
    part[:, 80:] = 2
    part[:3] = -1
    relative = TRUE + np.float32(TURN) * (3 * (part == 1))
    turns = fringe_order(relative, part, ROWS, STRIPE)
    assert (turns[part == 0] == 0).all()
    np.testing.assert_allclose(turns[part == 1], -3 * TURN)
    assert np.isnan(turns[part == 2]).all()
    assert np.isnan(turns[part == -1]).all()


def test_rows_that_disagree_are_refused():
    column = STRIPE + np.arange(40) % 2 * TURN / 0.7
    with pytest.raises(NoStripeError, match='do not agree'):
        fringe_order(TRUE, np.zeros(TRUE.shape, np.int32), ROWS, column)


@pytest.mark.parametrize('points', [0, 2])
def test_too_few_points_are_refused(points):
    with pytest.raises(NoStripeError):
        fringe_order(TRUE, np.zeros(TRUE.shape, np.int32), ROWS[:points], STRIPE[:points])


def test_points_beyond_the_image_do_no_harm():
    row, column = np.append(ROWS, [-3, 500]), np.append(STRIPE, [-40.0, 900.0])
    turns = fringe_order(TRUE, np.zeros(TRUE.shape, np.int32), row, column)
    np.testing.assert_array_equal(turns, 0)
