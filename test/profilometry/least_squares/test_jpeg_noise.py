from __future__ import annotations

import cv2
import numpy as np
import pytest

from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.least_squares.bins.compression import jpeg_variance
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.pixel_noise import PixelNoise

PERIOD, NOISE = 10.7, 1.3


@pytest.fixture(scope='module')
def fringes():
    """Inclined fringes, and the same with noise, rounded."""
    v, u = np.mgrid[:480, :640]
    true = 60 + 40 * np.cos(2 * np.pi * (u + 0.05 * v + 2e-5 * u * v) / PERIOD)
    seen = true + NOISE * np.random.default_rng(0).standard_normal(true.shape)
    return true, np.rint(seen).astype(np.uint8)


def through_jpeg(pixels, quality):
    _, data = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)


def on_fringes(error):
    """Mean square of an error at the frequency of upright fringes, in blocks of 8 pixels."""
    blocks = error.reshape(60, 8, 80, 8).sum(axis=1) / np.sqrt(8)
    u = np.arange(8) + 0.5
    waves = np.cos(np.pi / 8 * np.outer((1, 2), u)) / 2
    return float(np.mean(np.square(np.einsum('bcu,ku->bck', blocks, waves))))


@pytest.mark.parametrize('quality', [95, 90, 50, 30, 15])
def test_jpeg_tells_the_noise_that_fringes_have_by_it(fringes, quality):
    true, seen = fringes
    told = jpeg_variance(through_jpeg(seen, quality))
    assert told == pytest.approx(on_fringes(through_jpeg(seen, quality) - true), rel=0.35)


def test_what_decoding_rounds_in_each_colour_is_not_in_the_bins():
    phase = np.linspace(0, 40 * np.pi, 640)
    luma = np.tile(np.round(120 + 60 * np.cos(phase)), (96, 1)).astype(np.uint8)
    # Colours that go with the fringes' slope, as demosaicing leaves them.
    red = np.tile(np.round(128 + 4 * np.sin(phase)), (96, 1)).astype(np.uint8)
    decoded = cv2.cvtColor(np.dstack([luma, red, 255 - red]), cv2.COLOR_YCrCb2RGB)
    grid = Grid.for_fringes(640, 96, 32.0)
    coloured, grey = (IntensityBins.of(Photograph.of(each), grid).grey for each in (decoded, luma))
    assert np.abs(coloured - grey).max() < 0.02


def test_what_saw_no_jpeg_has_no_such_noise(fringes):
    true, seen = fringes
    assert jpeg_variance(seen) == 0
    assert jpeg_variance(np.rint(true).astype(np.uint8)) == 0
    assert jpeg_variance(np.full((480, 640), 90, np.uint8)) == 0
    assert jpeg_variance(np.full((4, 4), 90, np.uint8)) == 0
    # Blocks that do not begin at the border are none of JPEG's any more.
    assert jpeg_variance(np.ascontiguousarray(through_jpeg(seen, 50)[3:, 3:])) == 0


def test_noise_is_nowhere_less_than_it_is_said_to_be():
    noise = PixelNoise(np.arange(256, dtype=np.float32)).at_least(7)
    assert (noise.variance == np.maximum(np.arange(256), 7)).all()
