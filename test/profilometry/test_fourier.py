import numpy as np
import pytest

from ftp_dent_ros.profilometry.carrier import Carrier
from ftp_dent_ros.profilometry.fourier import analytic_signal, background, pass_band, spectrum

CARRIER = Carrier(1 / 8)
U = np.arange(640)


def rows(shift, amplitude=50.0, level=70.0, harmonic=0.0):
    angle = 2 * np.pi * U / 8 + shift
    red = level + amplitude * np.cos(angle) + harmonic * np.cos(2 * angle)
    return np.broadcast_to(red, (4, 640)).astype(np.float32)


def off(signal, phase):
    return np.abs(np.angle(signal * np.exp(-1j * phase))).max()


@pytest.mark.parametrize('harmonic', [0.0, 12.0])
def test_amplitude_and_phase_of_fringes(harmonic):
    bump = 0.8 * np.exp(-(((U - 320) / 60) ** 2))
    signal = analytic_signal(spectrum(rows(bump, harmonic=harmonic)), 640, CARRIER)
    assert signal.dtype == np.complex64
    assert off(signal, 2 * np.pi * U / 8 + bump) < 1e-3
    np.testing.assert_allclose(np.abs(signal), 50, atol=0.1)


def test_phase_grows_with_the_projector_s_columns():
    shift = 0.3
    signal = analytic_signal(spectrum(rows(shift)), 640, Carrier(1 / 8, -1))
    assert off(signal, -(2 * np.pi * U / 8 + shift)) < 1e-3


@pytest.mark.parametrize('size', [639, 640])
def test_band_passes_the_carrier_and_nothing_beyond_its_radius(size):
    gain = pass_band(size, CARRIER)
    frequency = np.fft.rfftfreq(size)
    assert gain.shape == frequency.shape
    assert (gain[np.abs(frequency - 1 / 8) < 0.03] == 1).all()
    assert (gain[np.abs(frequency - 1 / 8) > 1 / 16 + 1e-6] < 1e-12).all()
    assert (np.diff(gain[frequency > 1 / 8]) <= 0).all()


def test_background_is_the_light_below_the_fringes():
    light = 70 + 20 * np.cos(2 * np.pi * U / 320)
    transform = spectrum(rows(0.3, level=light))
    np.testing.assert_allclose(background(transform, 640, CARRIER)[0], light, atol=0.01)
