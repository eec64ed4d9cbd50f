"""Shapes of dents: their heights, slopes and sizes."""

import math

import numpy as np
import pytest

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation import Dent
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

SHAPES = Smooth(), RaisedCosine(), Gaussian(), Cap(), Plate(), FlatBottomed(), Crater(), Valley()


@pytest.mark.parametrize('shape', SHAPES, ids=lambda shape: type(shape).__name__)
def test_a_shape_is_whole_in_the_middle_nothing_at_the_border_and_has_its_slopes(shape):
    u, v = np.meshgrid(*[np.linspace(-1.1, 1.1, 67) * shape.border] * 2)
    value, along_u, along_v = shape.fraction(u, v)
    assert shape.fraction(np.zeros(1), np.zeros(1))[0] == pytest.approx([1], abs=1e-9)
    assert value.max() <= 1
    assert np.abs(value[u * u + v * v > shape.border**2]).max() < 1e-8
    step = 1e-7
    # A cap has a kink at its rim, and a Gaussian ends.
    even = np.abs(np.hypot(u, v) - shape.border) > 1e-3
    for (du, dv), slope in (((step, 0), along_u), ((0, step), along_v)):
        rise = shape.fraction(u + du, v + dv)[0] - shape.fraction(u - du, v - dv)[0]
        np.testing.assert_allclose(slope[even], (rise / (2 * step))[even], atol=1e-4)


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
    assert dent.size_at(0.1) == pytest.approx((0.06 * part, 0.04 * part), rel=1e-6)
    x, y = dent.outline(0.1).T
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
    length, width = crease.size_at(0.1)
    along = np.linspace(0, 0.025, 100001)
    ends = along[np.argmin(np.abs(crease.height(c * along, s * along)[0] - 0.00015))]
    assert length == pytest.approx(2 * ends, rel=1e-3)
    assert 0.003 < width < 0.007


def test_a_radius_that_the_width_cannot_have_is_refused():
    with pytest.raises(
        ConfigurationError, match=r'bluntness is 0\.64.*: give .* above 0 to 0\.499'
    ):
        Valley.of_radius(0.010, 0.002, radius=0.004)


def test_a_bulge_is_a_bump_and_a_gouge_leaves_a_mark():
    assert Dent(0, 0, 0.05, 0.05, -0.001, shape=Gaussian()).kind == 'bump'
    gouge = Dent(0, 0, 0.05, 0.004, 0.0005, shape=Valley(0.2, 'gouge'), mark=1.4)
    assert gouge.kind == 'gouge'
    bottom, beside = gouge.clean(np.zeros(2), np.array([0.0, 0.003]))
    assert (bottom, beside) == (pytest.approx(1.4), 1.0)
