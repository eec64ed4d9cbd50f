import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.node_interpolation import (
    NodeInterpolation,
    lagrange,
)


@pytest.mark.parametrize('count', [3, 6, 20])
def test_polynomials_are_interpolated_exactly(count):
    targets = np.linspace(-0.5, count - 0.5, 31)
    weights = lagrange(targets, count)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-9)
    within = (targets >= 0) & (targets <= count - 1)
    for nodes, some in ((6, within), (3, ~within)):
        power = min(count, nodes) - 1
        seen = weights[some] @ (np.arange(count) / count) ** power
        np.testing.assert_allclose(seen, (targets[some] / count) ** power, atol=1e-9)


def test_beyond_the_outermost_nodes_noise_is_about_twice_theirs():
    # Through six nodes it would be nine times as much.
    weights = lagrange(np.array([-0.5, 19.5]), 20)
    assert (np.linalg.norm(weights, axis=1) < 2.3).all()


@pytest.mark.parametrize('stride', [1, 2, 5])
def test_pixels_have_what_lies_between_their_nodes(stride):
    grid = Grid.for_fringes(211, 137, 11.7)
    interpolation = NodeInterpolation.of(grid, stride)

    def field(u, v):
        return np.sin(u / 31) + np.cos(v / 37) + 1e-4 * u * v

    nodes = field(*np.meshgrid(*grid.node_positions())).astype(np.float32)
    wide = interpolation.widened(nodes)
    u, v = np.arange(0, 211, stride), np.arange(0, 137, stride)
    expected = field(*np.meshgrid(u, v))
    smooth = np.full(expected.shape, np.nan)
    for rows, needed, weights in interpolation.rows:
        smooth[rows] = weights @ wide[needed]
    np.testing.assert_allclose(smooth, expected, atol=4e-3)
    within = [
        (at >= nodes[0]) & (at <= nodes[-1])
        for at, nodes in zip((v, u), grid.node_positions()[::-1], strict=True)
    ]
    inner = np.ix_(*within)
    np.testing.assert_allclose(smooth[inner], expected[inner], atol=2e-4)
