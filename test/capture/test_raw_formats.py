"""Bytes as cameras send them."""

import numpy as np
import pytest

from ftp_dent_ros.capture.raw_formats import GENICAM, V4L2
from ftp_dent_ros.errors import CameraError

# Levels of 12 bits and their bytes, by the layouts of PFNC 2.4 and of GigE Vision.
LEVELS = np.array([[0xABC, 0x123, 0x456, 0xFED], [0x001, 0x800, 0x7FF, 0x0F0]], np.uint16)
BYTES = {
    '': 'BC0A 2301 5604 ED0F 0100 0008 FF07 F000',
    'p': 'BC3A12 56D4FE 010080 FF070F',
    'packed': 'AB3C12 45D6FE 000180 7F0F0F',
}
TEN = np.array([[0x3FF, 0x001, 0x155, 0x2AA]], np.uint16)


@pytest.mark.parametrize(
    ('code', 'text', 'encoding', 'levels'),
    [
        (0x01100005, BYTES[''], 'mono12', LEVELS),
        (0x010C0047, BYTES['p'], 'mono12', LEVELS),
        (0x010C0006, BYTES['packed'], 'mono12', LEVELS),
        (0x010A0058, 'FF0750 95AA', 'bayer_rggb10', TEN),
        (0x010C0027, 'FF1300 55 21AA', 'bayer_rggb10', TEN),
    ],
)
def test_twelve_bits_of_a_grey_sensor_and_ten_of_a_mosaic(code, text, encoding, levels):
    data = np.frombuffer(bytes.fromhex(text), np.uint8)
    photograph = GENICAM[code].photograph(data, 4, len(levels))
    assert photograph.encoding == encoding
    np.testing.assert_array_equal(photograph.pixels, levels)


@pytest.mark.parametrize(
    ('code', 'encoding'),
    [
        (0x01080008, 'bayer_grbg8'),
        (0x0108000B, 'bayer_bggr8'),
        (0x0110000D, 'bayer_rggb10'),
        (0x01100012, 'bayer_gbrg12'),
        (0x01100031, 'bayer_bggr16'),
        (0x010C0059, 'bayer_rggb12'),
        (0x010A0054, 'bayer_gbrg10'),
        (0x010C002D, 'bayer_bggr12'),
        (0x01100007, 'mono16'),
        (0x0230001A, 'rgb12'),
    ],
)
def test_every_code_names_its_pixels(code, encoding):
    photograph = GENICAM[code].photograph(np.zeros(6 * 4 * 4, np.uint8), 4, 4)
    assert photograph.encoding == encoding


def test_colours_are_put_in_order():
    bgr = np.arange(24, dtype=np.uint8)
    pixels = GENICAM[0x02180015].photograph(bgr, 4, 2).pixels
    np.testing.assert_array_equal(pixels[0, 0], [2, 1, 0])
    np.testing.assert_array_equal(
        GENICAM[0x02180014].photograph(bgr, 4, 2).pixels[0, 0], [0, 1, 2]
    )


@pytest.mark.parametrize(
    ('code', 'encoding'),
    [('GREY', 'mono8'), ('Y12 ', 'mono12'), ('RG10', 'bayer_rggb10'), ('BYR2', 'bayer_bggr16')],
)
def test_lines_of_a_driver_may_be_padded(code, encoding):
    size = 1 if encoding.endswith('8') else 2
    lines = np.zeros((3, 4 * size + 8), np.uint8)
    lines[:, : 4 * size : size] = np.arange(12).reshape(3, 4)
    photograph = V4L2[code].photograph(lines.ravel(), 4, 3)
    assert photograph.encoding == encoding
    np.testing.assert_array_equal(photograph.pixels, np.arange(12).reshape(3, 4))


def test_too_few_bytes_are_told():
    with pytest.raises(CameraError, match='sends 5 bytes for 4x3 pixels of 12 bits'):
        V4L2['Y12 '].photograph(np.zeros(5, np.uint8), 4, 3)
