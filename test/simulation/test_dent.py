"""The dent function, eq. 18, and flush rivets."""

import math

import numpy as np
import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Dent, Rivet


def one(value):
    return np.array([value], float)


def height(feature, x, y):
    return float(feature.height(one(x), one(y))[0][0])


@pytest.mark.parametrize(
    ('r', 'golden'), [(0.0, 1.0), (0.5, 0.7165313106), (0.9, 0.0140777760), (1.0, 0), (1.1, 0)]
)
def test_it_is_equation_18_at_golden_values(r, golden):
    """exp(-1 / (1 - r^2)) is 0.368 at most and 0.005 at r = 0.9: here divided by the former."""
    dent = Dent(0, 0, length=2.0, width=2.0, depth=1.0)
    assert height(dent, r, 0) == pytest.approx(golden, abs=1e-10)
    assert height(dent, r * math.cos(1), r * math.sin(1)) == pytest.approx(golden, abs=1e-10)


def test_length_width_depth_and_angle():
    """60 x 40 mm, 2 mm deep, its length turned by 30 degrees from x towards y."""
    dent = Dent(0.1, -0.2, length=0.06, width=0.04, depth=0.002, angle=math.radians(30))
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    assert height(dent, 0.1, -0.2) == pytest.approx(0.002)
    along, across = 0.02999, 0.01999
    assert height(dent, 0.1 + 0.015 * c, -0.2 + 0.015 * s) == pytest.approx(0.002 * 0.7165313106)
    assert height(dent, 0.1 - 0.010 * s, -0.2 + 0.010 * c) == pytest.approx(0.002 * 0.7165313106)
    assert 0 <= height(dent, 0.1 + along * c, -0.2 + along * s) < 1e-12
    assert height(dent, 0.1 - across * s, -0.2 + across * c) < 1e-12
    assert height(dent, 0.1 + 0.025 * c, -0.2 + 0.025 * s) > 0
    assert height(dent, 0.1 - 0.025 * s, -0.2 + 0.025 * c) == 0


def test_a_negative_depth_is_a_bulge():
    assert height(Dent(0, 0, 0.05, 0.05, -0.001), 0, 0) == pytest.approx(-0.001)


@pytest.mark.parametrize(
    'feature',
    [
        Dent(0.01, -0.02, 0.06, 0.04, 0.002, 0.7),
        Rivet(0.01, -0.02, radius=0.02, groove=0.001, sigma=0.003, proud=0.0005),
    ],
)
def test_slopes_are_the_derivatives_of_the_height(feature):
    x, y = np.meshgrid(np.linspace(-0.03, 0.05, 41), np.linspace(-0.06, 0.02, 41))
    _, along_x, along_y = feature.height(x, y)
    step = 1e-7
    rise_x = feature.height(x + step, y)[0] - feature.height(x - step, y)[0]
    rise_y = feature.height(x, y + step)[0] - feature.height(x, y - step)[0]
    np.testing.assert_allclose(along_x, rise_x / (2 * step), atol=2e-6)
    np.testing.assert_allclose(along_y, rise_y / (2 * step), atol=2e-6)
    assert np.isfinite(along_x).all()


@pytest.mark.parametrize('feature', [Dent(0, 0, 0.06, 0.03, 0.002, 0.7), Rivet(0, 0)])
def test_nothing_rises_outside_what_it_covers(feature):
    half = 2 * feature.reach
    x, y = np.meshgrid(*[np.linspace(-half, half, 101)] * 2)
    outside = ~feature.covers(x, y)
    assert outside.any()
    assert np.abs(feature.height(x, y)[0])[outside].max() < 1e-9
    wider = feature.covers(x, y, feature.reach / 2)
    assert (wider | outside).all()
    assert wider.sum() > (~outside).sum()


def test_the_contour_at_a_tenth_of_the_depth():
    dent = Dent(0, 0, length=0.06, width=0.04, depth=0.002)
    length, width = dent.size_at(0.1)
    assert length == pytest.approx(0.0500994, abs=1e-7)
    assert width == pytest.approx(0.0333996, abs=1e-7)
    assert height(dent, length / 2, 0) == pytest.approx(0.0002)
    assert height(dent, 0, width / 2) == pytest.approx(0.0002)


def test_a_rivet_has_a_proud_head_in_a_dirty_groove():
    rivet = Rivet(0, 0)
    assert height(rivet, 0, 0) == pytest.approx(-30e-6)
    assert height(rivet, 0.004, 0) == pytest.approx(80e-6 - 15e-6)
    assert height(rivet, 0, 0.006) == pytest.approx(0, abs=1e-9)
    assert rivet.clean(one(0.004), one(0))[0] == pytest.approx(0.65)
    assert rivet.clean(one(0), one(0))[0] == pytest.approx(1)


@pytest.mark.parametrize('value', [0.0, -0.01, math.nan])
def test_a_size_that_is_none_is_refused(value):
    with pytest.raises(ConfigurationError, match=r'width is .*: give'):
        Dent(0, 0, 0.05, value, 0.001)
    with pytest.raises(ConfigurationError, match=r'sigma is .*: give'):
        Rivet(0, 0, sigma=value)
