from dataclasses import replace

import numpy as np
import pytest

from ftp_dent_ros.errors import OtherPatternError
from ftp_dent_ros.files import config_folder
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.checks.epipolar import ONE_IN, check_epipolar, check_rows
from ftp_dent_ros.profilometry.checks.rows import Rows
from ftp_dent_ros.profilometry.rig_alarm import TOLERANCE, joint, off, rig_alarm
from ftp_dent_ros.rig.rig import read_rig

PATTERN = Pattern(1280, 720, 10.0, 640.0, code='contrast')
RIG = read_rig(config_folder() / 'rig.yaml')
NODES = np.meshgrid(np.arange(2.0, 1280, 4), np.arange(3.0, 720, 6))
RAYS = RIG.camera.rays(np.stack(NODES, axis=-1))
# Of a wall at 0.8 m.
LIT = np.moveaxis(RIG.projector.project(RIG.to_projector(0.8 * RAYS)), -1, 0)
WINDOW = 5.0


def rows(rng, noise=0.005, away=lambda u, v: 0.0, pattern=PATTERN, seen=None):
    """What the nodes of an image would show: noise as wide as windows, and uneven shading."""
    (x, y), (u_p, v_p) = NODES, LIT
    light = v_p + away(u_p - 640, v_p - 360)
    white = np.fft.rfft2(rng.normal(size=x.shape))
    low = np.hypot(*np.meshgrid(np.fft.rfftfreq(320), np.fft.fftfreq(120)))
    blurred = np.fft.irfft2(white * np.exp(-((low / 0.15) ** 2)), s=x.shape)
    shading = 0.8 - 0.2 * ((x - 700) / 640) ** 2 + 1e-4 * y
    contrast = shading * pattern.row_contrast(light) * np.exp(noise * blurred / blurred.std())
    inside = (u_p > 3) & (u_p < 1276) & (v_p > 3) & (v_p < 716)
    return Rows(u_p, v_p, contrast, inside if seen is None else inside & seen, RAYS[..., :2])


def check(seen, pattern=PATTERN):
    return check_epipolar(RIG, pattern, seen, WINDOW)


@pytest.mark.parametrize(
    ('shift', 'turn', 'stretch'),
    [(0.3, 0.0, 0.0), (-1.2, 0.0004, 0.0), (5.0, -0.003, 0.01), (17.0, 0.03, 0.067)],
)
def test_finds_what_the_light_is_off_by(shift, turn, stretch):
    seen = rows(np.random.default_rng(0), away=lambda u, v: shift + turn * u + stretch * v)
    found = check(seen)
    assert found.seen
    assert found.turn == pytest.approx(turn, abs=4 * found.turn_deviation)
    assert found.stretch == pytest.approx(stretch, abs=4 * found.stretch_deviation)
    # In the middle of what is seen, which is near the panel's.
    near = 4 * found.shift_deviation + 60 * (abs(turn) + abs(stretch))
    assert found.shift == pytest.approx(shift, abs=near)
    assert found.shift_deviation < 0.05


def test_the_stated_uncertainties_are_those_of_noise():
    found = [check(rows(np.random.default_rng(seed), 0.03)) for seed in range(60)]
    for name in ('shift', 'turn', 'stretch'):
        normalised = [getattr(one, name) / getattr(one, f'{name}_deviation') for one in found]
        assert 0.7 < np.sqrt(np.mean(np.square(normalised))) < 1.4


def test_says_what_it_does_to_the_cloud():
    degree = np.radians(0.1)
    focal = RIG.projector.camera_matrix[1, 1]
    found = check(rows(np.random.default_rng(0), 0.001, lambda u, v: degree * focal))
    # A pitch moves fringes hardly, a yaw as large by its angle over the baseline's.
    assert found.depth_error < 0.2e-3
    assert 3e-3 < found.blind_depth_error < 10e-3
    assert '+3.3' in found.sentence
    assert 'hardly show' in found.sentence


def test_an_edge_through_a_row_of_blocks_does_not_speak_for_all():
    _, y = NODES
    plain = rows(np.random.default_rng(3))
    edge = (y > 380) & (y < 440)
    found = check(replace(plain, contrast=plain.contrast * np.where(edge, 1.06, 1.0)))
    assert abs(found.shift) < 4 * found.shift_deviation
    assert found.shift_deviation < 0.1


@pytest.mark.parametrize('slope', [-0.1, 0.0, 0.07])
def test_a_level_shadow_over_all_of_the_skin_is_no_other_scale_of_rows(slope):
    x, y = NODES
    plain = rows(np.random.default_rng(3))
    # The sun's light has no fringes: beyond the edge they are half as strong.
    share = 1 / (1 + np.exp(-(y - 380 - slope * (x - 640)) / 6))
    found = check(replace(plain, contrast=plain.contrast / (1 + share)))
    check_rows(PATTERN, found)
    assert abs(found.stretch) < 4 * found.stretch_deviation
    assert found.strength == pytest.approx(check(plain).strength, rel=0.1)


def test_says_nothing_where_too_little_is_seen_or_told():
    x, _ = NODES
    seen = rows(np.random.default_rng(0))
    assert check(rows(np.random.default_rng(0), seen=x < 200)) is None
    assert check(rows(np.random.default_rng(0), seen=x < 0)) is None
    assert check(seen, pattern=replace(PATTERN, code='stripe')) is None
    assert check(seen, pattern=replace(PATTERN, row_depth=0.0)) is None


@pytest.mark.parametrize(
    ('away', 'words'),
    [
        (lambda u, v: 0.067 * v + 0.5, r'1\.067 times as far apart as rig and'),
        (lambda u, v: -0.063 * v, r'0\.93[78] times as far apart'),
        (lambda u, v: 719 - 2 * (v + 360), r'2[12] px beside'),
        (lambda u, v: 12.0, '12 px beside'),
    ],
    ids=['larger', 'smaller', 'upside down', 'beside'],
)
def test_rows_of_another_pattern_are_refused(away, words):
    found = check(rows(np.random.default_rng(1), away=away))
    with pytest.raises(OtherPatternError, match=words):
        check_rows(PATTERN, found)


def test_a_pattern_without_rows_is_refused_and_hidden_ones_are_not():
    even = replace(PATTERN, row_depth=0.0)
    with pytest.raises(OtherPatternError, match=r'every 46\.5 px'):
        check_rows(PATTERN, check(rows(np.random.default_rng(2), pattern=even)))
    hidden = check(rows(np.random.default_rng(2), noise=0.8))
    assert not hidden.seen
    check_rows(PATTERN, hidden)


def test_a_true_rig_raises_no_alarm_and_one_that_is_off_does_by_the_third_cloud():
    for seed, noise in enumerate((0.003, 0.01, 0.03, 0.1) * 10):
        true = check(rows(np.random.default_rng(seed), noise))
        assert not rig_alarm([true] * 5)
    for sign in (-1, 1):
        off_by = [
            check(rows(np.random.default_rng(seed), 0.003, lambda u, v, s=sign: s * 0.3))
            for seed in range(3)
        ]
        assert not rig_alarm(off_by[:2])
        assert 'the rig does not hold' in rig_alarm(off_by)
        turned = [
            check(rows(np.random.default_rng(seed), 0.002, lambda u, v, s=sign: s * 9e-4 * u))
            for seed in range(3)
        ]
        assert 'the rig does not hold' in rig_alarm(turned)


def test_an_alarm_needs_the_odds_that_it_states():
    # Of three figures that may each be off, this one is a third of the odds.
    one = check(rows(np.random.default_rng(0)))
    normal = np.random.default_rng(0).standard_t(one.places - 3, 200_000)
    told = [
        off(
            [
                replace(
                    one,
                    shift=TOLERANCE * np.sign(t) + t * one.shift_deviation,
                    turn=0.0,
                    stretch=0.0,
                )
            ]
        )
        for t in normal[np.abs(normal) > 4]
    ]
    assert np.count_nonzero(told) <= 5
    assert len(normal) == ONE_IN


@pytest.mark.parametrize('common', [0.0, 0.7, 1.0])
def test_several_clouds_are_as_sure_as_what_they_do_not_share_lets_them_be(common):
    one = check(rows(np.random.default_rng(0)))
    rng = np.random.default_rng(1)
    normalised, deviations = [], []
    for _ in range(2000):
        parts = common * rng.normal() + np.sqrt(1 - common**2) * rng.normal(size=5)
        mean, deviation = joint([replace(one, shift=t * one.shift_deviation) for t in parts])[:, 0]
        normalised.append(mean / deviation)
        deviations.append(deviation / one.shift_deviation)
    assert 0.5 < np.std(normalised) < 1.15
    assert np.mean(deviations) < 0.8 if common == 0 else np.mean(deviations) > 0.7
