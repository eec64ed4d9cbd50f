from dataclasses import asdict

import cv2
import numpy as np
import pytest
import yaml

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.pattern import (
    Pattern,
    pattern_from_image,
    read_pattern,
    write_pattern,
)
from ftp_dent_ros.rig import Lens

PATTERN = Pattern(640, 360, 8.0, 320.0)


def test_phase_and_column_are_inverse():
    u = np.linspace(-20, 700, 101)
    np.testing.assert_allclose(PATTERN.column(PATTERN.phase(u)), u, atol=1e-12)
    assert PATTERN.phase(320.0) == 0
    assert PATTERN.phase(328.0) == pytest.approx(2 * np.pi)


def test_drawn_pixels_follow_the_formula():
    image = PATTERN.draw()
    assert image.shape == (360, 640, 3)
    assert image.dtype == np.uint8
    u = np.arange(640)
    np.testing.assert_allclose(image[0, :, 0] / 254, PATTERN.intensity(u), atol=0.5 / 254)
    stripe = PATTERN.in_stripe(u)
    assert stripe.sum() == 9
    assert np.all(image[:, stripe, 1:] == 0)
    assert np.array_equal(image[:, ~stripe, 1], image[:, ~stripe, 0])


def test_rounding_to_grey_levels_shifts_no_fringe():
    row = PATTERN.draw()[0, :, 0].astype(float)
    carrier = np.exp(-1j * PATTERN.phase(np.arange(640)))
    assert abs(np.angle(row @ carrier)) < 1e-12


@pytest.mark.parametrize(
    'pattern',
    [
        PATTERN,
        Pattern(1280, 720, 7.3, 400.25),
        Pattern(1920, 1080, 11.0, 960.0),
        Pattern(854, 480, 16.0, 426.5),
        Pattern(1280, 720, 9.142857, 640.0),
        Pattern(320, 8, 20.0, 100.3),
        Pattern(1280, 720, 8.123456, 639.98765),
    ],
    ids=lambda pattern: f'{pattern.width}px/{pattern.period_px}',
)
def test_reads_itself_back(pattern):
    read = pattern_from_image(pattern.draw())
    assert (read.width, read.height) == (pattern.width, pattern.height)
    assert read.period_px == pytest.approx(pattern.period_px, abs=1e-4)
    assert read.stripe_center_px == pytest.approx(pattern.stripe_center_px, abs=2e-4)


def test_reads_a_pattern_drawn_elsewhere(data):
    for scene in sorted((data / 'scenes').iterdir()):
        image = cv2.cvtColor(cv2.imread(str(scene / 'pattern.png')), cv2.COLOR_BGR2RGB)
        assert pattern_from_image(image) == read_pattern(scene / 'pattern.yaml')


def sawtooth():
    row = (np.arange(640) * 32 % 256).astype(np.uint8)
    image = np.tile(row[:, None], (360, 1, 3)).copy()
    image[:, 316:325, 1:] = 0
    return image


@pytest.mark.parametrize(
    'image',
    [
        np.zeros((360, 640, 3), np.uint8),
        np.full((360, 640, 3), 255, np.uint8),
        np.zeros((360, 640), np.uint8),
        PATTERN.draw().astype(np.float32),
        PATTERN.draw()[..., [0, 0, 0]],
        PATTERN.draw().transpose(1, 0, 2),
        np.random.default_rng(0).integers(0, 256, (360, 640, 3), np.uint8),
        sawtooth(),
        np.zeros((0, 0, 3), np.uint8),
    ],
    ids=[
        'black',
        'white',
        'grey',
        'float',
        'no-stripe',
        'horizontal',
        'random',
        'sawtooth',
        'empty',
    ],
)
def test_an_image_that_is_no_pattern_is_refused(image):
    with pytest.raises(PatternError, match='publish'):
        pattern_from_image(image)


def test_write_then_read(tmp_path):
    write_pattern(tmp_path / 'pattern.yaml', PATTERN)
    assert read_pattern(tmp_path / 'pattern.yaml') == PATTERN


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('width', None),
        ('height', None),
        ('period_px', None),
        ('stripe_center_px', None),
        ('width', 0),
        ('height', 12.5),
        ('period_px', 2.0),
        ('period_px', 200.0),
        ('period_px', float('nan')),
        ('period_px', 'eight'),
        ('stripe_center_px', -4.0),
        ('stripe_center_px', 639.0),
        ('axis', 'v'),
        ('colour', 'red'),
    ],
)
def test_each_wrong_field_is_named(tmp_path, field, value):
    data = asdict(PATTERN) | {field: value}
    if value is None:
        del data[field]
    path = tmp_path / 'pattern.yaml'
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(PatternError) as error:
        read_pattern(path)
    assert str(path) in str(error.value)
    assert field in str(error.value)


def test_a_pattern_must_fit_its_projector():
    lens = Lens(1280, 720, np.diag([1000.0, 1000.0, 1.0]), np.zeros(5))
    with pytest.raises(PatternError, match='640x360, the projector 1280x720'):
        PATTERN.check_fits(lens)


@pytest.mark.parametrize(
    ('period', 'centre', 'levels'), [(10.0, 640.0, 254), (9.0, 594.1, 254), (12.5, 640.3, 255)]
)
def test_the_rounding_of_levels_is_told_as_it_shifts_the_fringes(period, centre, levels):
    pattern = Pattern(1280, 720, period, centre, levels=levels)
    u = np.arange(100, 100 + 1000)  # whole fringes of each period, but for the second
    row = pattern.draw()[0, u, 0].astype(float)
    shift = np.angle((row - row.mean()) @ np.exp(-1j * pattern.phase(u)))
    told = np.sqrt(pattern.rounding_variance)
    assert told < 2e-3
    assert abs(shift) < 2 * told + 2e-4
