"""What fits in Gaussian windows leave of waves and of noise."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from ftp_dent_ros.cloud.response import halved, left_out, white_noise

WINDOW = 4.0


def fitted(field, fits):
    """What some fits in windows pass, each of which corrects the ones before."""
    left = field
    for _ in range(fits):
        left = left - gaussian_filter(left, WINDOW, mode='wrap')
    return field - left


@pytest.mark.parametrize('fits', [1, 4, 8])
def test_half_of_a_wave_is_left_at_the_stated_wavelength(fits):
    wave = np.cos(2 * np.pi * np.arange(4000) / (halved(fits) * WINDOW))
    passed = fitted(wave, fits)[1000:3000]
    assert passed.std() / wave[1000:3000].std() == pytest.approx(0.5, abs=0.01)
    assert left_out(2 * (np.pi / halved(fits)) ** 2, fits) == pytest.approx(0.5)


@pytest.mark.parametrize('fits', [1, 8])
@pytest.mark.parametrize('wide', [0.0, 6.0])
def test_white_noise_is_as_strong_as_stated(fits, wide):
    white = np.random.default_rng(3).standard_normal((800, 800))
    passed = fitted(white, fits)
    if wide:
        passed = gaussian_filter(passed, wide, mode='wrap')
    once = gaussian_filter(white, WINDOW, mode='wrap')
    variance, frequency = white_noise(wide / WINDOW, fits)
    assert passed.var() / once.var() == pytest.approx(variance, rel=0.04)
    slopes = np.gradient(passed, axis=1).var() * WINDOW**2 / passed.var()
    assert slopes == pytest.approx(frequency, rel=0.1)
