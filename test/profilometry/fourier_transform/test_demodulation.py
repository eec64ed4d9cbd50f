import numpy as np
import pytest

from ftp_dent_ros.profilometry.carrier import Carrier
from ftp_dent_ros.profilometry.fourier import analytic_signal, spectrum
from ftp_dent_ros.profilometry.fourier_transform.demodulation import demodulate, find_rims

CARRIER = Carrier(1 / 8)
U = np.arange(320)
REFERENCE = np.broadcast_to(2 * np.pi * U / 8, (12, 320)).astype(np.float32)
# What a tilted, dented panel shows, at another distance than the reference.
PHASE = REFERENCE + 0.9 + 0.01 * U + 0.7 * np.exp(-(((U - 170) / 25) ** 2))


def seen(inside):
    level = 70 + 60 * np.cos(PHASE)
    return np.where(inside, level, 9).astype(np.float32)


def panel():
    inside = np.zeros(REFERENCE.shape, bool)
    inside[2:10, 83:251] = True
    return inside


def off(signal, at):
    return np.abs(np.angle(signal * np.exp(-1j * PHASE)))[at]


@pytest.mark.parametrize(
    'inside',
    [
        [0, 0, 1, 1, 1, 0, 0, 0],
        [1, 1, 0, 0, 0, 0, 1, 1],
        [1, 0, 1, 0, 0, 1, 0, 0],
        [1] * 8,
        [0] * 8,
    ],
)
def test_each_pixel_outside_belongs_to_the_nearest_rim(inside):
    inside = np.array([inside, inside], bool)
    rims = find_rims(inside)
    assert rims.share.sum() == (~inside & inside.any()).sum()
    assert (inside[rims.row, rims.column]).all()
    nearest = np.repeat(rims.column, rims.share)
    outside = np.nonzero(~inside & inside.any())[1]
    every = rims.column[: len(rims.column) // 2]
    for column, own in zip(outside, nearest, strict=True):
        assert abs(column - own) == np.abs(every - column).min()


def test_phase_is_right_up_to_the_rim():
    inside = panel()
    signal, explained = demodulate(seen(inside), inside, REFERENCE, CARRIER)
    assert explained[inside].mean() > 0.99
    error = off(signal, inside)
    plain = off(analytic_signal(spectrum(seen(inside)), 320, CARRIER), inside)
    assert error.max() < 0.12
    assert error.mean() < 0.2 * plain.mean()
    np.testing.assert_allclose(np.abs(signal)[inside], 60, atol=6)


def test_the_plain_carrier_continues_rows_too():
    ramp = np.broadcast_to(2 * np.pi * U / 8 + 2.0, (12, 320)).astype(np.float32)
    inside = panel()
    signal, _ = demodulate(seen(inside), inside, ramp, CARRIER)
    assert off(signal, inside).max() < 0.12


def test_what_lies_outside_is_never_looked_at():
    inside = panel()
    rows = seen(inside)
    first, _ = demodulate(rows, inside, REFERENCE, CARRIER)
    rows[~inside] = np.random.default_rng(0).uniform(0, 255, (~inside).sum())
    again, _ = demodulate(rows, inside, REFERENCE, CARRIER)
    np.testing.assert_array_equal(first, again)


def test_dirt_is_not_explained_and_spreads_less():
    inside = panel()
    rows = seen(inside)
    peak = 140 + rows[5, 140:150].argmax()
    rows[5, peak - 1 : peak + 1] = 0
    signal, explained = demodulate(rows, inside, REFERENCE, CARRIER)
    assert not explained[5, peak - 1 : peak + 1].any()
    assert (inside & ~explained).sum() < 15
    near = np.zeros(inside.shape, bool)
    near[5, peak - 20 : peak + 21] = True
    plain = analytic_signal(spectrum(rows), 320, CARRIER)
    assert off(signal, near).max() < 0.7 * off(plain, near).max()


def test_an_empty_region_gives_nothing():
    inside = np.zeros(REFERENCE.shape, bool)
    signal, explained = demodulate(seen(inside), inside, REFERENCE, CARRIER)
    assert not signal.any()
    assert not explained.any()
