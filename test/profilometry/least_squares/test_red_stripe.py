"""The red stripe as a fringe like the others, and the blur that its edges show."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.red_stripe import without_stripe

ROWS, COLUMNS, PERIOD = 120, 160, 4.8  # bins
RED = 0.3  # of the grey levels


def seen(blur, tilt=0.1, stripe=True):
    """Bins of fringes whose stripe has no green and blue, blurred; and those of white fringes."""
    fine = 16
    u = (np.arange(COLUMNS * fine) + 0.5) / fine - 0.5
    v = np.arange(ROWS)[:, None]
    phase = 2 * np.pi * (u - COLUMNS / 2 + tilt * (v - ROWS / 2)) / PERIOD
    fringes = 60 * (1 + np.cos(phase))
    others = fringes * (np.abs(phase) > np.pi) if stripe else fringes

    def photographed(light):
        blurred = cv2.GaussianBlur(light, (0, 0), fine * blur, sigmaY=1e-3)
        return blurred[:, fine // 2 :: fine].astype(np.float32)

    red, white = photographed(fringes) + 20, photographed(fringes) + 20
    light = SimpleNamespace(red=red, grey=RED * red + (1 - RED) * (photographed(others) + 20))
    return light, phase[:, fine // 2 :: fine].astype(np.float32), white


@pytest.mark.parametrize('blur', [0.4, 0.8, 1.4])
@pytest.mark.parametrize('tilt', [0.1, 0.0])
def test_its_edges_tell_the_blur(blur, tilt):
    light, phase, white = seen(blur, tilt)
    told = without_stripe(light, phase, np.ones_like(phase, bool), PERIOD)
    assert told.blur == pytest.approx(blur**2, rel=0.15, abs=0.08)
    assert np.abs(told.levels - white)[:, 8:-8].max() < 2.5


def test_without_a_stripe_there_is_nothing_to_tell():
    light, phase, _ = seen(0.8, stripe=False)
    told = without_stripe(light, phase, np.ones_like(phase, bool), PERIOD)
    assert told.blur == 0
    np.testing.assert_allclose(told.levels, light.grey, atol=0.1)


def test_one_channel_is_left_as_it_is():
    light, phase, _ = seen(0.8)
    grey = SimpleNamespace(red=light.grey, grey=light.grey)
    told = without_stripe(grey, phase, np.ones_like(phase, bool), PERIOD)
    assert told.levels is light.grey
    assert told.blur == 0
