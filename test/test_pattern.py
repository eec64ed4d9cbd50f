from dataclasses import asdict

import cv2
import numpy as np
import pytest
import yaml

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.pattern.drawn import pattern_from_image
from ftp_dent_ros.pattern.file import read_pattern, write_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.rig.rig import Lens

PATTERN = Pattern(640, 360, 8.0, 320.0)
CODED = Pattern(1280, 720, 10.0, 640.0, code='contrast')


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


@pytest.mark.parametrize(
    'pattern',
    [
        PATTERN,
        Pattern(1280, 720, 7.3, 400.25),
        Pattern(320, 8, 20.0, 100.3),
        CODED,
        Pattern(1280, 720, 10.0, 643.5, code='contrast', low_contrast=0.9),
        Pattern(854, 480, 7.3, 426.25, levels=255, code='contrast'),
        Pattern(1920, 8, 4.0, 960.0, code='contrast'),
        Pattern(640, 360, 10.0, 320.0, code='contrast', row_depth=0.0),
        Pattern(640, 360, 10.0, 320.0, code='contrast', row_depth=0.2, row_period_px=40.0),
        Pattern(640, 401, 7.3, 320.0, code='contrast', row_depth=0.055, row_period_px=31.37),
        Pattern(640, 360, 8.0, 180.0, 'v'),
        Pattern(360, 1280, 10.0, 640.0, 'v', code='contrast'),
    ],
    ids=lambda pattern: f'{pattern.width}px/{pattern.period_px}',
)
def test_reads_itself_back(pattern):
    read = pattern_from_image(pattern.draw())
    assert (read.width, read.height) == (pattern.width, pattern.height)
    assert read.period_px == pytest.approx(pattern.period_px, abs=1e-4)
    assert read.stripe_center_px == pytest.approx(pattern.stripe_center_px, abs=3e-4)
    assert (read.code, read.levels, read.axis) == (pattern.code, pattern.levels, pattern.axis)
    assert read.row_depth == pytest.approx(pattern.row_depth, abs=1e-3)
    if pattern.row_depth:
        assert read.row_period_px == pytest.approx(pattern.row_period_px, abs=2e-3)
    assert read.low_contrast == pytest.approx(pattern.low_contrast, abs=1e-3)


def test_the_stripe_stays_what_a_file_without_a_code_is(tmp_path):
    plain = Pattern(640, 360, 8.0, 320.0)
    assert plain.code == 'stripe'
    assert (plain.contrast(np.linspace(-500, 500)) == 1).all()
    for pattern in (plain, CODED):
        path = tmp_path / f'{pattern.code}.yaml'
        write_pattern(path, pattern)
        assert read_pattern(path) == pattern
    assert 'low_contrast' not in (tmp_path / 'stripe.yaml').read_text()


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
        np.where(np.arange(360)[:, None, None] < 100, CODED.draw()[:360], CODED.draw()[23:383]),
        CODED.draw()[:, ::-1],
        CODED.draw()[::-1],
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
        'sheared',
        'mirrored-code',
        'upside-down-code',
        'random',
        'sawtooth',
        'empty',
    ],
)
def test_an_image_that_is_no_pattern_is_refused(image):
    with pytest.raises(PatternError, match='publish'):
        pattern_from_image(image)


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('width', None),
        ('stripe_center_px', None),
        ('width', 0),
        ('height', 12.5),
        ('period_px', 2.0),
        ('period_px', 'eight'),
        ('stripe_center_px', -4.0),
        ('stripe_center_px', 639.0),
        ('axis', 'w'),
        ('row_depth', 0.5),
        ('row_period_px', 4.0),
        ('code', 'colour'),
        ('low_contrast', 1.0),
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
