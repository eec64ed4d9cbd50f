import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.pixel_noise import PixelNoise


def fringes(noise, shape=(480, 640)):
    """Inclined fringes with a noise whose variance is a function of the light."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[: shape[0], : shape[1]]
    light = 120 + 80 * np.cos(2 * np.pi * (u + 0.1 * v) / 12)
    seen = light + np.sqrt(noise(light)) * rng.standard_normal(shape)
    return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


NOISES = {
    'read': lambda level: 4.0 + 0 * level,
    'shot': lambda level: 1 + 0.05 * level,
    'speckle': lambda level: (0.03 * level) ** 2,
}


@pytest.mark.parametrize('noise', NOISES.values(), ids=NOISES)
def test_noise_is_known_by_level(noise):
    found = PixelNoise.of(fringes(noise)).variance
    level = np.arange(50, 200)
    np.testing.assert_allclose(found[level], noise(level) + 1 / 12, rtol=0.35)
    assert found[level].mean() == pytest.approx((noise(level) + 1 / 12).mean(), rel=0.08)


def test_without_noise_it_is_that_of_rounding():
    assert (PixelNoise.of(np.full((64, 64), 90, np.uint8)).variance == np.float32(1 / 12)).all()


def test_on_the_phase_the_flanks_count():
    variance = np.arange(256, dtype=np.float32)
    level, modulation = np.full((2, 2), 100, np.float32), np.full((2, 2), 60, np.float32)
    on_phase, with_texture, on_texture = PixelNoise(variance).of_fringes(level, modulation)
    # Linear in the level: the mean weighted by 2 sin^2 is the variance at the middle.
    np.testing.assert_allclose(on_phase, 100, atol=0.6)
    # Noise of bright pixels acts on both alike: the mean of 2 sin^2 cos^2 is a quarter.
    np.testing.assert_allclose(with_texture, 60 / 4, atol=0.6)
    np.testing.assert_allclose(on_texture, 100 / 4, atol=0.6)
    peaked = np.where(np.abs(np.arange(256) - 100) < 30, 1, 0).astype(np.float32)
    assert (PixelNoise(peaked).of_fringes(level, modulation)[0] > 0.5).all()
