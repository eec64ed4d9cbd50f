import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.camera_effects import lag_of_bins, take_harmonics

PERIOD = 11.7
GRID = Grid.for_fringes(640, 240, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)


@pytest.fixture
def fringes():
    phase = 2 * np.pi * GRID.bin_positions()[0] / PERIOD
    phase = np.tile(phase, (GRID.bin_shape[0], 1)).astype(np.float32)
    return phase, np.full(phase.shape, 70, np.float32)


def taken(rest, amplitude, phase):
    work = np.empty((GRID.strips()[0].stop, GRID.bin_shape[1]), np.float32)
    mask = np.ones(phase.shape, bool)
    return take_harmonics(rest, amplitude, np.cos(phase), mask, GRID, work)


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
    lag = lag_of_bins(nodes.astype(np.float32), plane, GRID, WINDOWS)
    assert lag[5, 20:-20].mean() == pytest.approx(
        0.002 * 2 * np.pi / PERIOD * GRID.bin_variance, rel=0.02
    )
    assert led == pytest.approx(lag[5, 20:-20].mean(), rel=0.25)
