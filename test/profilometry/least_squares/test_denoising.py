from functools import cache

import cv2
import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.noise.bands import split
from ftp_dent_ros.profilometry.least_squares.noise.denoising import denoise
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import noise_through
from ftp_dent_ros.profilometry.least_squares.noise.response import Response

PERIOD = 11.7
GRID = Grid.for_fringes(900, 720, PERIOD)
WINDOWS = Windows.for_fringes(PERIOD, GRID)
RESPONSE = Response.of(PERIOD, GRID, 4)
VARIANCE = 0.01  # of the bins, in amplitudes


@cache
def gain():
    return noise_through(GRID, WINDOWS, RESPONSE)


def through_windows(seed, scale=1.0):
    """White noise of `VARIANCE` as it comes through the fits: half of it in phase, doubled."""
    bins = np.random.default_rng(seed).standard_normal(GRID.bin_shape, np.float32)
    return fitted(bins * np.float32(scale * np.sqrt(2 * VARIANCE)))


def fitted(bins):
    """What the fits make of the bins."""
    field = np.zeros(GRID.shape, np.float32)
    for _ in range(4):
        known = cv2.resize(field, bins.shape[::-1], interpolation=cv2.INTER_LINEAR)
        field = field + WINDOWS.gaussian(GRID.at_nodes(bins - known))
    return field


def dent(width, depth):
    """A Gaussian dent in the middle, `width` in nodes."""
    rows, columns = np.indices(GRID.shape)
    square = (rows - GRID.shape[0] / 2) ** 2 + (columns - GRID.shape[1] / 2) ** 2
    return (depth * np.exp(-0.5 * square / width**2)).astype(np.float32)


def cleaned(values, texture=None, contrast=None, pixels=VARIANCE, variance=VARIANCE, doubt=0.0):
    # Noise that does not depend on the light, at the texture's frequency as at the fringes'.
    known = np.multiply.outer([pixels, 0, pixels / 4], np.ones(GRID.shape)).astype(np.float32)
    variance = np.full(GRID.shape, variance, np.float32)
    texture = np.zeros(GRID.shape, np.float32) if texture is None else texture
    contrast = np.zeros(GRID.shape, np.float32) if contrast is None else contrast
    inside = np.ones(GRID.shape, bool)
    doubt = np.full(GRID.shape, doubt, np.float32)
    return denoise(
        *(values, texture, contrast, known, variance, doubt, inside),
        *(WINDOWS, RESPONSE, gain(), (0.0,) * 5),
    )


def rms(field):
    return float(np.sqrt(np.square(field[8:-8, 8:-8]).mean()))


def test_the_pixels_noise_is_taken_off():
    noise = through_windows(1)
    done = cleaned(noise)
    assert rms(done.values) < 0.35 * rms(noise)


def test_a_dent_keeps_its_depth():
    # Six nodes are three windows: a dent of some three fringes.
    for depth in (0.5, 3.0):
        shape = dent(6.0, depth)
        done = cleaned(shape + through_windows(2))
        middle = tuple(size // 2 for size in GRID.shape)
        assert done.values[middle] == pytest.approx(shape[middle], abs=0.04 + 0.02 * depth)


def test_what_the_pixels_do_not_show_stays_and_is_told():
    noise = through_windows(3, scale=5.0)
    done = cleaned(noise, variance=25 * VARIANCE)
    assert rms(done.values) > 0.8 * rms(noise)
    # Neighbouring bands overlap, so that their noise together is more than the sum that is told.
    assert 0.6 < rms(done.values / np.sqrt(done.variance)) < 1.3


@pytest.mark.parametrize('depth', [0.0, 0.3, 2.0])
def test_normalised_errors(depth):
    shape = dent(6.0, depth)
    done = cleaned(shape + through_windows(4))
    assert 0.4 < rms((done.values - shape) / np.sqrt(done.variance)) < 1.2


def test_the_noise_below_all_bands_is_that_of_many_samples():
    below = [split(through_windows(seed), WINDOWS)[1] for seed in range(40, 60)]
    sampled = np.square(np.array(below)[:, 20:-20, 20:-20]).mean() / VARIANCE
    assert gain().shares[-1] == pytest.approx(sampled, rel=0.25)


@pytest.mark.parametrize('lines', [0.0, 2.0])
def test_noise_that_goes_along_the_fringes_is_told(lines):
    # The same in all rows, as gains of columns make it and the beats of an enlarged picture.
    normalised = []
    for seed in (12, 22, 32):
        rows = np.random.default_rng(seed).standard_normal((1, GRID.bin_shape[1]), np.float32)
        bins = np.repeat(rows, GRID.bin_shape[0], axis=0)
        noise = through_windows(seed + 1)
        noise += fitted(bins * np.float32(np.sqrt(2 * lines * VARIANCE)))
        done = cleaned(noise, pixels=0.01 * VARIANCE, variance=(1 + lines) * VARIANCE)
        normalised.append(rms(noise / np.sqrt(done.variance)))
    # Three lots of so few lines; without them the bands' overlap alone is seen, which is not told.
    assert 0.9 < np.sqrt(np.mean(np.square(normalised))) < 1.25


def test_texture_is_taken_off_by_what_it_leaves_at_twice_the_phase():
    grain = WINDOWS.gaussian(np.random.default_rng(5).standard_normal(GRID.shape, np.float32))
    grain *= np.float32(0.05 / grain.std())
    shape = dent(6.0, 1.0)
    # An albedo of 1 + e sin Phi: -e on the phase, e / 2 of sin 2 Phi.
    feigned = shape - grain
    noise = through_windows(6, scale=0.1)
    done = cleaned(feigned + noise, texture=grain / 2, pixels=0.01 * VARIANCE)
    plain = cleaned(feigned + noise, pixels=0.01 * VARIANCE)
    assert rms(done.values - shape) < 0.35 * rms(plain.values - shape)
    assert rms((done.values - shape) / np.sqrt(done.variance)) < 1.2


def test_of_a_texture_that_says_nothing_nothing_is_taken():
    other = WINDOWS.gaussian(np.random.default_rng(7).standard_normal(GRID.shape, np.float32))
    other *= np.float32(0.05 / other.std())
    shape = dent(6.0, 1.0)
    values = shape + through_windows(8)
    assert rms(cleaned(values, texture=other).values - cleaned(values).values) < 0.01


def test_what_is_missed_of_coarse_dirt_is_told():
    # Grains of all sizes; their sign is half another's, which no pixel's noise tells.
    grain, other = (
        sum(
            size * WINDOWS.gaussian(white, size)
            for size in (1.0, 3.0, 8.0)
            for white in [np.random.default_rng(seed).standard_normal(GRID.shape, np.float32)]
        )
        for seed in (9, 10)
    )
    scale = np.float32(0.05 / grain.std())
    noise = through_windows(11, scale=0.02)
    few = 0.0004 * VARIANCE
    sign = (grain + np.float32(0.4) * other) * scale / 2
    done = cleaned(noise - grain * scale, texture=sign, pixels=few, variance=few)
    assert rms(done.values) < 0.6 * rms(grain * scale)
    assert 0.7 < rms(done.values / np.sqrt(done.variance)) < 1.4


def test_detail_in_doubt_is_told_and_nothing_smooth():
    sharp = cleaned(dent(3.0, 0.5), doubt=1.0)
    middle = tuple(size // 2 for size in GRID.shape)
    assert np.sqrt(sharp.foreign[middle]) > 0.4 * 0.5
    assert cleaned(dent(3.0, 0.5)).foreign.max() == 0
    smooth = cleaned(dent(40.0, 0.5), doubt=1.0)
    assert np.sqrt(smooth.foreign[middle]) < 0.03


def test_light_of_one_side_band_is_told_by_the_contrast():
    # About the fringes' frequency, less of it above than below: smooth grains in sunlight.
    white = np.random.default_rng(13).standard_normal((2, *GRID.shape), np.float32)
    spectrum = np.fft.fft(white[0] + 1j * white[1], axis=1)
    spectrum[:, np.fft.fftfreq(GRID.shape[1]) > 0] *= 0.2
    both = np.fft.ifft(spectrum, axis=1)
    amplitude, phase = (
        WINDOWS.gaussian(each.astype(np.float32)) * np.float32(0.2)
        for each in (both.real, both.imag)
    )
    contrast = amplitude + np.float32(np.log(0.2))
    few = 0.01 * VARIANCE
    noise, texture = through_windows(14, scale=0.1), through_windows(15, scale=0.05)
    done = cleaned(noise + phase, texture, contrast, pixels=few, variance=few)
    assert rms(done.values) < 0.75 * rms(phase)
    assert 0.7 < rms(done.values / np.sqrt(done.variance)) < 1.4
