"""The sensor: noise, blur, gamma, colour filter, compression."""

import dataclasses
import math

import numpy as np
import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Photometry
from ftp_dent_ros.simulation.sensor import blur, read_out

QUIET = Photometry(psf_px=0.0, full_well=1e15, read_noise=0.0)


def even(level, shape=(200, 250)):
    return np.full((3, *shape), level / 255, np.float32)


def smooth_scene():
    u, v = np.meshgrid(np.arange(96), np.arange(64))
    red = 0.5 + 0.3 * np.sin(u / 9)
    green = 0.5 + 0.3 * np.cos(v / 8)
    return np.stack([red, green, 0.3 + 0.004 * u]).astype(np.float32)


@pytest.mark.parametrize('level', [20.0, 60.0, 200.0])
@pytest.mark.parametrize(('full_well', 'read_noise'), [(12000.0, 0.8), (3000.0, 2.0)])
def test_noise_is_shot_and_read_noise(level, full_well, read_noise):
    """Variance: the level's electrons, the reading, and a twelfth for whole grey levels."""
    photometry = Photometry(psf_px=0.0, full_well=full_well, read_noise=read_noise)
    image = read_out(even(level), photometry, np.random.default_rng(2)).shown().astype(float)
    expected = level * 255 / full_well + read_noise**2 + 1 / 12
    # The error of a variance of 150 000 values is 0.4 %.
    assert image.var() == pytest.approx(expected, rel=0.02)
    assert image.mean() == pytest.approx(level, abs=0.03)
    channels = np.corrcoef(image.reshape(-1, 3).T)
    assert np.abs(channels - np.eye(3)).max() < 0.02
    neighbours = np.corrcoef(image[:, 1:, 0].ravel(), image[:, :-1, 0].ravel())[0, 1]
    assert abs(neighbours) < 0.02


@pytest.mark.parametrize('gamma', [1.0, 1.8])
def test_gamma_bends_the_levels_which_end_at_0_and_255(gamma):
    levels = np.array([0, 10, 100, 200, 255, 400], float)
    signal = np.tile((levels / 255).astype(np.float32), (3, 4, 1))
    photometry = dataclasses.replace(QUIET, camera_gamma=gamma)
    image = read_out(signal, photometry, np.random.default_rng(0)).shown()
    expected = np.rint(255 * np.minimum(levels / 255, 1) ** (1 / gamma))
    assert (image[1, :, 1] == expected).all()


@pytest.mark.parametrize('sigma', [0.4, 1.0, 2.5])
def test_blur_has_the_variance_asked_for_and_keeps_the_light(sigma):
    point = np.zeros((41, 41), np.float32)
    point[20, 20] = 1
    image = blur(point, sigma).astype(float)
    offset = np.arange(41) - 20
    assert image.sum() == pytest.approx(1, abs=1e-5)
    assert image.sum(axis=0) @ offset**2 == pytest.approx(sigma**2, rel=0.01)
    assert image.sum(axis=1) @ offset**2 == pytest.approx(sigma**2, rel=0.01)


def test_colour_filter_keeps_a_smooth_scene_in_its_colours():
    plain = read_out(smooth_scene(), QUIET, np.random.default_rng(0)).shown()
    through = dataclasses.replace(QUIET, bayer=True)
    image = read_out(smooth_scene(), through, np.random.default_rng(0)).shown()
    difference = np.abs(image.astype(int) - plain)[2:-2, 2:-2]
    assert difference.max() <= 4
    assert 0 < difference.mean() < 1
    # What a filter passes is the light itself: RGGB.
    assert (image[2:-2:2, 2:-2:2, 0] == plain[2:-2:2, 2:-2:2, 0]).all()
    assert (image[3:-2:2, 3:-2:2, 2] == plain[3:-2:2, 3:-2:2, 2]).all()
    assert (image[2:-2:2, 3:-2:2, 1] == plain[2:-2:2, 3:-2:2, 1]).all()


@pytest.mark.parametrize('encoding', ['rgb8', 'mono8'])
def test_jpeg_harms_the_more_the_lower_its_quality(encoding):
    signal, errors = smooth_scene(), []
    quiet = dataclasses.replace(QUIET, encoding=encoding)
    plain = read_out(signal, quiet, np.random.default_rng(0)).pixels.astype(int)
    for quality in (95, 75, 20):
        photometry = dataclasses.replace(quiet, jpeg_quality=quality)
        image = read_out(signal, photometry, np.random.default_rng(0)).pixels
        errors.append(np.abs(image - plain).mean())
    assert 0 < errors[0] < errors[1] < errors[2] < 8
    assert errors[0] < 1.5


WRONG = {
    'exposure': (0, math.nan),
    'ambient': (-0.1, math.inf),
    'projector_black': (1.1,),
    'encoding': ('yuv422', 'mono'),
    'jpeg_quality': (101,),
    'samples': (3,),
}


@pytest.mark.parametrize(
    ('name', 'value'), [(n, v) for n, values in WRONG.items() for v in values]
)
def test_a_value_out_of_its_range_is_refused_by_name(name, value):
    with pytest.raises(ConfigurationError) as refusal:
        Photometry(**{name: value})
    message = str(refusal.value)
    assert message.startswith(f'{name} is {value!r}: give ')
    assert '\n' not in message
