"""The dent function, eq. 18, and flush rivets."""

import math

import numpy as np
import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Dent, Rivet, domed_rivet
from ftp_dent_ros.simulation.dents import (
    Cap,
    Crater,
    FlatBottomed,
    Gaussian,
    Plate,
    RaisedCosine,
    Smooth,
    Valley,
)


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


def assert_slopes(height, x, y, atol):
    """The derivatives that a function gives are those of the height that it gives."""
    step = 1e-7
    for (dx, dy), slope in zip(((step, 0), (0, step)), height(x, y)[1:], strict=True):
        rise = height(x + dx, y + dy)[0] - height(x - dx, y - dy)[0]
        np.testing.assert_allclose(slope, rise / (2 * step), atol=atol)


@pytest.mark.parametrize(
    'feature',
    [
        Dent(0.01, -0.02, 0.06, 0.04, 0.002, 0.7),
        Rivet(0.01, -0.02, radius=0.02, groove=0.001, sigma=0.003, proud=0.0005),
    ],
)
def test_slopes_are_the_derivatives_of_the_height(feature):
    x, y = np.meshgrid(np.linspace(-0.03, 0.05, 41), np.linspace(-0.06, 0.02, 41))
    assert_slopes(feature.height, x, y, 2e-6)


def test_a_rivet_has_a_proud_head_in_a_dirty_groove():
    rivet = Rivet(0, 0)
    assert height(rivet, 0, 0) == pytest.approx(-30e-6)
    assert height(rivet, 0.004, 0) == pytest.approx(80e-6 - 15e-6)
    assert height(rivet, 0, 0.006) == pytest.approx(0, abs=1e-9)
    assert rivet.clean(one(0.004), one(0))[0] == pytest.approx(0.65)
    assert rivet.clean(one(0), one(0))[0] == pytest.approx(1)


SHAPES = Smooth(), RaisedCosine(), Gaussian(), Cap(), Plate(), FlatBottomed(), Crater(), Valley()


@pytest.mark.parametrize('shape', SHAPES, ids=lambda shape: type(shape).__name__)
def test_a_shape_is_whole_in_the_middle_nothing_at_the_border_and_has_its_slopes(shape):
    u, v = np.meshgrid(*[np.linspace(-1.1, 1.1, 67) * shape.border] * 2)
    value, _, _ = shape.fraction(u, v)
    assert shape.fraction(np.zeros(1), np.zeros(1))[0] == pytest.approx([1], abs=1e-9)
    assert value.max() <= 1
    assert np.abs(value[u * u + v * v > shape.border**2]).max() < 1e-8
    # A cap has a kink at its rim, and a Gaussian ends.
    even = np.abs(np.hypot(u, v) - shape.border) > 1e-3
    assert_slopes(shape.fraction, u[even], v[even], 1e-4)


@pytest.mark.parametrize(
    ('shape', 'part'),
    [
        (RaisedCosine(), math.acos(-0.8) / math.pi),
        (Gaussian(), 1.0),
        (Cap(), math.sqrt(0.9)),
        (Plate(), math.sqrt(1 - math.sqrt(0.1))),
        (FlatBottomed(0.5), 0.5 + 0.5 * math.acos(-0.8) / math.pi),
        (Crater(0.2, 0.7), 0.7 * math.acos(-0.6 / 1.2) / math.pi),
    ],
    ids=lambda value: type(value).__name__,
)
def test_sizes_on_the_contour_at_a_tenth_of_the_depth(shape, part):
    dent = Dent(0.02, -0.01, 0.06, 0.04, 0.002, 0.4, shape)
    assert dent.size() == pytest.approx((0.06 * part, 0.04 * part), rel=1e-6)
    x, y = dent.outline().T
    height, _, _ = dent.height(x + dent.x, y + dent.y)
    np.testing.assert_allclose(height, 0.0002, rtol=1e-6)


def test_a_crease_has_the_radius_asked_for_and_its_sizes_end_to_end():
    crease = Dent(0, 0, 0.050, 0.007, 0.0015, 0.3, Valley.of_radius(0.007, 0.0015, radius=0.0008))
    assert crease.kind == 'crease'
    step = 1e-6
    across = np.array([-step, 0.0, step])
    s, c = math.sin(crease.angle), math.cos(crease.angle)
    height, _, _ = crease.height(-s * across, c * across)
    curvature = (height[0] - 2 * height[1] + height[2]) / step**2
    assert -1 / curvature == pytest.approx(0.0008, rel=0.01)
    length, width = crease.size()
    along = np.linspace(0, 0.025, 100001)
    ends = along[np.argmin(np.abs(crease.height(c * along, s * along)[0] - 0.00015))]
    assert length == pytest.approx(2 * ends, rel=1e-3)
    assert 0.003 < width < 0.007


def test_a_radius_that_the_width_cannot_have_is_refused():
    with pytest.raises(ConfigurationError, match=r'bluntness is 0\.64.* above 0 to 0\.499'):
        Valley.of_radius(0.010, 0.002, radius=0.004)


def test_a_bulge_is_a_bump_and_stands_out_and_a_gouge_leaves_a_mark():
    assert height(domed_rivet(0, 0), 0, 0) == pytest.approx(-0.0012)
    assert Dent(0, 0, 0.05, 0.05, -0.001, shape=Gaussian()).kind == 'bump'
    gouge = Dent(0, 0, 0.05, 0.004, 0.0005, shape=Valley(0.2, 'gouge'), mark=1.4)
    assert gouge.kind == 'gouge'
    bottom, beside = gouge.clean(np.zeros(2), np.array([0.0, 0.003]))
    assert (bottom, beside) == (pytest.approx(1.4), 1.0)
