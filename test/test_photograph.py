import numpy as np
import pytest

from ftp_dent_ros.errors import ImageError
from ftp_dent_ros.photograph.photograph import MOSAICS, Photograph

GREY = np.full((4, 6), 90, np.uint8)


@pytest.mark.parametrize(
    ('image', 'mosaic', 'bits', 'encoding'),
    [
        (GREY, '', 0, 'mono8'),
        (np.dstack([GREY] * 3), '', 0, 'rgb8'),
        (GREY, 'rggb', 0, 'bayer_rggb8'),
        (GREY.astype(np.uint16) << 4, '', 12, 'mono12'),
        (np.array([[16, 48], [0, 65520]], np.uint16), '', 0, 'mono16'),
        (np.zeros((4, 4), np.uint16), 'grbg', 10, 'bayer_grbg10'),
    ],
)
def test_says_what_it_is(image, mosaic, bits, encoding):
    photograph = Photograph.of(image, mosaic, bits)
    assert photograph.encoding == encoding
    assert Photograph.of(photograph) is photograph
    assert photograph.is_grey == (encoding[:4] != 'baye')


@pytest.mark.parametrize(
    ('image', 'mosaic', 'bits', 'said'),
    [
        (GREY.astype(float), '', 0, 'float64, not of 8- or 16-bit'),
        ([[1]], '', 0, 'list, not'),
        (np.zeros((2, 2, 4), np.uint8), '', 0, 'shape 2x2x4'),
        (np.zeros((2, 2, 3), np.uint8), 'rggb', 0, 'shape 2x2x3'),
        (GREY, 'rgbg', 0, "mosaic is 'rgbg': give one of rggb"),
        (np.full((2, 2), 5000, np.uint16), '', 12, 'level 5000, more than 12 bits'),
        (GREY, '', 12, 'white is 4095, outside 15 to 255'),
    ],
)
def test_what_is_no_photograph_is_refused(image, mosaic, bits, said):
    with pytest.raises(ImageError, match=said):
        Photograph.of(image, mosaic, bits)


def test_a_response_makes_levels_of_light():
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    linear = Photograph(levels, mosaic='gbrg').linear(np.linspace(0, 1, 256) ** 2)
    assert (linear.white, linear.mosaic) == (65535, 'gbrg')
    light = linear.pixels.ravel() / 65535
    np.testing.assert_allclose(light[:254], (np.arange(254) / 255) ** 2, atol=1e-5)
    assert (light[254:] == 1).all()


@pytest.mark.parametrize('mosaic', MOSAICS)
def test_colours_are_where_the_mosaic_has_them(mosaic):
    raw = np.zeros((32, 32), np.uint16)
    levels = {'r': 3000, 'g': 2000, 'b': 1000}
    for colour, row, column in Photograph(raw, 4095, mosaic).lattices():
        raw[row::2, column::2] = levels[colour]
    photograph = Photograph(raw, 4095, mosaic)
    assert photograph.rgb()[10, 10].tolist() == [3000, 2000, 1000]
    assert photograph.shown()[10, 10].tolist() == [187, 125, 62]
