"""Light that changes from photograph to photograph."""

from __future__ import annotations

import numpy as np
import pytest

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.flicker import fall_of_light, flicker, light_of
from ftp_dent_ros.photograph.photograph import Photograph

FRINGES = Pattern(320, 200, 10.0, 160.0).draw()[:, :140] / 254


def taken(strength, colour=(1, 1, 1), view=0, mosaic=''):
    """A photograph of fringes on a skin that grows darker towards one end."""
    skin = np.linspace(1, 0.8, FRINGES.shape[1])[:, None]
    pixels = 180 * strength * np.roll(FRINGES, view, axis=1) * skin * np.array(colour)
    pixels = np.rint(pixels).astype(np.uint8)
    if not mosaic:
        return Photograph.of(pixels)
    flat = np.empty(pixels.shape[:2], np.uint8)
    for place, name in enumerate(mosaic):
        row, column = divmod(place, 2)
        flat[row::2, column::2] = pixels[row::2, column::2, 'rgb'.index(name)]
    return Photograph(flat, mosaic=mosaic)


def of(photographs):
    return flicker([light_of(each) for each in photographs])


def test_steady_light_on_a_moving_skin_does_not_flicker():
    found = of([taken(1 - 0.02 * index, view=7 * index) for index in range(12)])
    assert found.worst < 0.005
    assert found.text.endswith(' %, colour 0.0 %')


@pytest.mark.parametrize('mosaic', ['', 'rggb'])
def test_strength_and_colour_are_told_apart(mosaic):
    noise = np.random.default_rng(2).normal(0, 0.05, (12, 3))
    bright = of([taken(1 + each[0], mosaic=mosaic) for each in noise])
    tinted = of([taken(1, 1 + each - each.mean(), mosaic=mosaic) for each in noise])
    assert bright.strength == pytest.approx(0.05, rel=0.5)
    assert bright.colour < 0.01
    assert tinted.colour == pytest.approx(0.05, rel=0.5)
    assert tinted.strength < 0.02


def test_grey_photographs_have_no_colour_and_darkness_tells_nothing():
    grey = [Photograph.of(taken(1 + 0.05 * (index % 2)).pixels[..., 1]) for index in range(6)]
    found = of(grey)
    assert found.colour < 1e-12 and found.strength > 0.03
    dark = Photograph.of(np.zeros((64, 64), np.uint8))
    assert of([dark] * 5) is None
    assert of(grey[:2]) is None


def test_light_falls_on_a_skin_with_its_slope_and_the_square_of_its_distance():
    y, x = np.meshgrid(np.linspace(-0.01, 0.01, 64), np.linspace(-0.01, 0.01, 64), indexing='ij')
    for distance, slope in ((0.5, 0.0), (1.0, 0.0), (0.5, 0.5)):
        points = np.stack([x, y, distance + slope * x], axis=-1).astype(np.float32)
        points[:20, 7] = np.nan
        expected = np.cos(np.arctan(slope)) / distance**2
        assert fall_of_light(points, np.zeros(3)) == pytest.approx(expected, rel=0.01)
    assert np.isnan(fall_of_light(np.full((40, 40, 3), np.nan), np.zeros(3)))
