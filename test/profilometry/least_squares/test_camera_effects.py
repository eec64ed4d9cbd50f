import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.camera_effects import lag_of_blur, take_harmonics

PERIOD = 11.7
GRID = Grid.for_fringes(640, 240, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)
# Blur of the bins alone, radians^2.
USUAL = np.full(GRID.shape, (2 * np.pi / PERIOD) ** 2 * GRID.bin_variance, np.float32)


@pytest.fixture
def fringes():
    phase = 2 * np.pi * GRID.bin_positions()[0] / PERIOD
    phase = np.tile(phase, (GRID.bin_shape[0], 1)).astype(np.float32)
    return phase, np.full(phase.shape, 70, np.float32)


def taken(rest, amplitude, phase):
    mask = np.ones(phase.shape, bool)
    return take_harmonics(rest, amplitude, np.cos(phase), mask)


def test_harmonics_of_a_curve_are_taken_off(fringes):
    phase, amplitude = fringes
    rest = amplitude * (0.08 * np.cos(2 * phase) - 0.03 * np.cos(3 * phase))
    other = np.float32(0.5) * np.sin(5 * phase)
    rest = (rest + other).astype(np.float32)
    assert taken(rest, amplitude, phase) == pytest.approx(0.08, abs=1e-3)
    np.testing.assert_allclose(rest, other, atol=0.05)


def test_of_a_straight_camera_nothing_is(fringes):
    phase, amplitude = fringes
    rest = np.full(phase.shape, 0.01, np.float32)
    assert taken(rest, amplitude, phase) == 0
    assert (rest == np.float32(0.01)).all()


def test_averages_lead_towards_the_light():
    # Light that grows by 0.2 % a pixel, photographed without noise.
    u = np.arange(640)
    light = np.exp(0.002 * (u - 320))
    phase = 2 * np.pi * u / PERIOD
    signal = light * np.exp(1j * phase)
    bins = [
        GRID.binned(np.tile(np.rint(128 + 60 * part), (240, 1)).clip(0, 255).astype(np.uint8))
        for part in (signal.real, signal.imag)
    ]
    seen = np.angle((bins[0] - 128 + 1j * (bins[1] - 128))[5])
    true = 2 * np.pi * GRID.bin_positions()[0] / PERIOD
    inner = slice(20, -20)
    led = np.angle(np.exp(1j * (seen - true)))[inner].mean()
    nodes = np.tile(60 * np.exp(0.002 * (GRID.node_positions()[0] - 320)), (GRID.shape[0], 1))
    plane = np.tile(true, (GRID.bin_shape[0], 1)).astype(np.float32)
    nodes = nodes.astype(np.float32)
    lag, _ = lag_of_blur(nodes, np.ones(GRID.shape, bool), plane, GRID, WINDOWS, USUAL, 0.0)
    assert lag[5, 20:-20].mean() == pytest.approx(
        0.002 * 2 * np.pi / PERIOD * GRID.bin_variance, rel=0.02
    )
    assert led == pytest.approx(lag[5, 20:-20].mean(), rel=0.25)


def test_the_end_of_a_surface_is_no_change_of_light():
    # The light grows by 0.05 % a pixel up to where the surface ends, and is carried on to zero.
    u, _ = GRID.node_positions()
    on_it = np.tile(u < 300, (GRID.shape[0], 1))
    light = np.where(on_it, 60 * np.exp(0.0005 * u), 0).astype(np.float32)
    phase = np.tile(2 * np.pi * GRID.bin_positions()[0] / PERIOD, (GRID.bin_shape[0], 1))
    lag, _ = lag_of_blur(light, on_it, phase.astype(np.float32), GRID, WINDOWS, USUAL, 0.0)
    true = 0.0005 * 2 * np.pi / PERIOD * GRID.bin_variance
    np.testing.assert_allclose(lag[on_it], true, rtol=0.02)


@pytest.mark.parametrize('code', [False, True])
@pytest.mark.parametrize('of_camera', [1.0, 0.0])
def test_blur_leads_towards_the_light_and_the_longer_fringes(of_camera, code):
    # Light and fringes grow along the row, and the camera blurs them by 2.5 pixels, or not at all.
    blur = 2.5**2
    u = np.arange(0, 680, 0.25)
    slow = 2 * np.pi / PERIOD * (u - 1e-4 * np.square(u - 320))
    signal = np.exp(0.001 * (u - 320) + 1j * slow)
    sigma = np.sqrt(of_camera * blur) / 0.25
    away = np.arange(-60, 61)
    kernel = np.exp(-0.5 * np.square(away / max(sigma, 1e-3)))
    blurred = np.convolve(signal, kernel / kernel.sum(), 'same')
    nodes, bins = (
        np.searchsorted(u, each) for each in (GRID.node_positions()[0], GRID.bin_positions()[0])
    )
    led = np.angle(blurred * signal.conj())[nodes]
    light = np.tile(60 * np.abs(blurred)[nodes], (GRID.shape[0], 1)).astype(np.float32)
    phase = np.tile(np.unwrap(np.angle(blurred))[bins], (GRID.shape[0], 1)).astype(np.float32)
    everywhere = np.ones(GRID.shape, bool)
    whole = GRID.bin_variance + blur
    in_phase = whole * np.square(np.gradient(slow, u)[nodes]) + np.zeros_like(light)
    seen = (0.0, in_phase) if code else (whole, None)
    lag, variance = lag_of_blur(light, everywhere, phase, GRID, WINDOWS, USUAL, *seen)
    alone, sure = lag_of_blur(light, everywhere, phase, GRID, WINDOWS, USUAL, 0.0)
    inner = slice(25, -25)
    error = (lag - alone - led)[5, inner]
    deviation = np.sqrt(variance[5, inner])
    assert not sure.any()
    assert np.abs(error / deviation).max() < 1.3
    assert np.abs(error / deviation).mean() > 0.7
