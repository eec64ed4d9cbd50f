"""The projector's light as a field over its image."""

import dataclasses

import numpy as np
import pytest
from brute_force import light_at

from ftp_dent_ros.simulation import Photometry
from ftp_dent_ros.simulation.renderer import Light

LAMP = Photometry(projector_black=0.0)


def total(projected, photometry, beyond=12, fine=8):
    """Integral of the light over the image and around it, projector pixels."""
    height, width, _ = projected.shape
    step = (np.arange(-beyond * fine, (width + beyond) * fine) + 0.5) / fine - 0.5
    rows = np.arange(-beyond * fine, (height + beyond) * fine) / fine
    u, v = np.meshgrid(step, rows)
    light = Light(projected, photometry).at(u.ravel(), v.ravel())
    return light.sum(axis=1) / fine**2


@pytest.mark.parametrize('defocus', [0.0, 0.7, 2.0])
def test_defocus_spreads_light_and_loses_none(defocus):
    image = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    light = total(image, dataclasses.replace(LAMP, defocus_px=defocus))
    np.testing.assert_allclose(light, image.sum(axis=(0, 1)) / 255, rtol=1e-3)


def test_one_pixel_is_a_blurred_square():
    image = np.zeros((9, 15, 3), np.uint8)
    image[4, 7] = 255, 0, 128
    u = np.linspace(3, 11, 161)
    light = Light(image, LAMP).at(u, np.full(161, 4.0))
    expected = light_at(image, u, np.full(161, 4.0), 0.7, 0.0)
    np.testing.assert_allclose(light.T, expected, atol=0.01)
    assert light[0] @ u / light[0].sum() == pytest.approx(7, abs=1e-3)
    assert not light[1].any()


def test_fringes_keep_their_place_and_their_contrast(pattern):
    """Where the renderer reads them, they are the exact blur to a thousandth of full light."""
    image = pattern.draw()
    u = np.linspace(20, 60, 2000)
    v = np.full(2000, 50.0)
    expected = light_at(image, u, v, 0.7, 0.01)
    light = Light(image, Photometry()).at(u, v).T
    assert np.abs(light - expected).max() < 3e-3
    wave = np.exp(-2j * np.pi * u / 8)
    ratio = ((light[:, 0] - light[:, 0].mean()) @ wave) / (
        (expected - expected.mean(0))[:, 0] @ wave
    )
    assert abs(np.angle(ratio)) < 1e-4
    assert abs(abs(ratio) - 1) < 0.005


def test_black_and_gamma():
    image = np.full((9, 9, 3), 128, np.uint8)
    photometry = Photometry(projector_black=0.1, projector_gamma=2.2)
    middle = np.array([4.0])
    expected = 0.1 + 0.9 * (128 / 255) ** 2.2
    np.testing.assert_allclose(Light(image, photometry).at(middle, middle), expected, atol=1e-4)


def test_a_list_of_any_length_is_read(pattern):
    light = Light(pattern.draw(), Photometry())
    for count in (1, 4096, 5000):
        u = np.full(count, 40.25)
        assert light.at(u, u).shape == (3, count)
