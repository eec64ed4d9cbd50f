"""Contrasts of fringes in light that grows, and steps of the code through a blur."""

from dataclasses import replace

import numpy as np
import pytest

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.code.contrast_code import ContrastSteps
from ftp_dent_ros.profilometry.least_squares.code.expected_steps import BLURS, ExpectedSteps
from ftp_dent_ros.profilometry.least_squares.code.fringe_contrast import fringe_contrasts
from ftp_dent_ros.profilometry.least_squares.fringe_orders.misfits import misfit_in_light

PATTERN = Pattern(1280, 720, 10.0, 640.0, code='contrast')
ROWS, FRINGES, HIGH = 40, 60, 5


def seen(expected, order=0):
    """Steps of so many rows and fringes of the code, from an order on."""
    place = np.arange(FRINGES) + order - expected.first
    step = np.tile(expected.steps[place], (ROWS, 1)).astype(np.float32)
    return ContrastSteps(0, 0, step, np.full(step.shape, 2500, np.float32))


@pytest.mark.parametrize('direction', [1, -1])
def test_light_that_grows_takes_no_amplitude_from_a_fringe(direction):
    phase = direction * 2 * np.pi / 16 * (np.arange(320) + 0.5) - np.pi / 2
    fringes = 100 + 60 * np.cos(phase) + 2 * np.arange(320)
    everywhere = np.ones((1, 320), bool)
    found = fringe_contrasts(
        fringes[None].astype(np.float32), phase[None].astype(np.float32), everywhere, everywhere
    )
    # Taken for a part of the fringes, it would change their amplitude by 32 / pi.
    np.testing.assert_allclose(np.exp(found.amplitude), np.full(20, 60), rtol=1e-3)


@pytest.mark.parametrize('blur', BLURS)
def test_a_blur_makes_steps_larger_and_another_order_none_of_them(blur):
    expected = ExpectedSteps.of(PATTERN, blur)
    assert expected.size > ExpectedSteps.of(PATTERN).size or blur == BLURS[0]
    steps = seen(expected, -30)
    for each in BLURS:
        decoded = steps.decoded(ExpectedSteps.of(PATTERN, each))
        assert decoded.order == -30 or not decoded.sure
    assert steps.decoded(expected).sure


def test_light_that_is_added_over_some_fringes_hides_no_order():
    expected = ExpectedSteps.of(PATTERN)
    steps = seen(expected)
    level = np.zeros_like(steps.step)
    level[:, 20:23] = 0.4
    shaded = replace(steps, step=steps.step - level, amplitude=steps.step)
    beside = slice(None), slice(18, 25)

    def misfit(steps, order):
        return misfit_in_light(steps, expected, order, 1.0, HIGH)[beside]

    assert misfit(replace(shaded, amplitude=None), 0).max() > 0.3
    assert misfit(shaded, 0).max() < 0.01
    for order in (-20, -1, 1, 7):
        assert misfit(shaded, order).mean() > 0.3
