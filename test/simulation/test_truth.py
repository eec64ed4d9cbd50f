import numpy as np
import pytest

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Panel, Surface
from ftp_dent_ros.simulation.dents import Dent
from ftp_dent_ros.simulation.truth import match_truth, true_dents

POSE = Pose.from_rpy((0.3, -0.4, 2.0), (5, -3, 1))
BARE = Surface((Panel(POSE, (-1, 1, -1, 1), 2.0),))
DENTS = (Dent(0.4, 0.1, 0.08, 0.05, 0.002, 0.7), Dent(-0.2, 0.3, 0.06, 0.06, -0.001))


@pytest.fixture
def dented():
    return Surface((Panel(POSE, (-1, 1, -1, 1), 2.0, dents=DENTS),))


def test_the_true_dent_lies_where_the_surface_is_pushed_in(dented):
    deep, bulge = true_dents(dented)
    assert abs(BARE.distance(deep.position)) < 1e-9
    # The bottom, straight below the centre: on the dented skin, by its depth behind the bare one.
    bottom = deep.position - deep.depth * deep.normal
    assert BARE.distance(bottom) == pytest.approx(deep.depth, abs=1e-6)
    assert dented.distance(bottom) == pytest.approx(0, abs=5e-6)
    assert bulge.depth == pytest.approx(-0.001, rel=0.01)
    assert deep.normal @ deep.axis == pytest.approx(0, abs=1e-3)


def test_its_outline_is_the_contour_at_a_tenth_of_the_depth(dented):
    deep, _ = true_dents(dented)
    panel = dented.panels[0]
    x, y, _ = POSE.inverse().apply(deep.outline).T
    height = panel.height(x, y)[0] - panel.bare_height(x, y)[0]
    np.testing.assert_allclose(height, 0.1 * 0.002, rtol=1e-9)
    x, y, _ = POSE.inverse().apply(deep.border).T
    assert np.abs(panel.height(x, y)[0] - panel.bare_height(x, y)[0]).max() < 1e-12
    assert (deep.length, deep.width) == pytest.approx((0.835 * 0.08, 0.835 * 0.05), rel=1e-3)


TRUE = np.array([[0.0, 0.0, 0.8], [0.03, 0.0, 0.8], [0.2, 0.0, 0.8]])


def at(*x: float) -> np.ndarray:
    return np.array([[each, 0.0, 0.8] for each in x]).reshape(-1, 3)


@pytest.mark.parametrize(
    ('found', 'pairs'),
    [
        ((), {}),
        ((0.201, 0.001), {0: 1, 2: 0}),
        ((0.001, 0.002), {0: 0}),
        ((0.014, 0.016), {0: 0, 1: 1}),
        ((0.016,), {1: 0}),
        ((0.1,), {}),
    ],
)
def test_the_nearest_within_reach_is_taken_once(found, pairs):
    assert match_truth(at(*found), TRUE, 0.02) == pairs


def test_no_found_place_is_left_out_for_a_nearer_one():
    # The middle one is nearest to both, the other is the first one's alone.
    assert match_truth(at(0.014, -0.016), TRUE, 0.02) == {0: 1, 1: 0}
    assert match_truth(at(0.0), (), 0.05) == {}
