import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.cloud_builder import (
    CloudBuilder,
    Published,
    parted,
)
from ftp_dent_ros.profilometry.least_squares.fit.regions import surfaces_in
from ftp_dent_ros.rig.rig import Lens, Rig

WIDTH, HEIGHT = 211, 137
NOTHING = np.zeros((12, 30), bool)
MATRIX = np.array([[200.0, 0, 105], [0, 200, 68], [0, 0, 1]])


@pytest.mark.parametrize('stride', [1, 2, 5])
def test_points_have_what_lies_between_their_nodes(stride):
    lens = Lens(WIDTH, HEIGHT, MATRIX, np.zeros(5))
    grid = Grid.for_fringes(WIDTH, HEIGHT, 11.7)
    u, v = np.meshgrid(*grid.node_positions())

    def field(u, v, start):
        return np.float32(start + 2e-3 * u - 1e-3 * v)

    measured = np.ones(grid.bin_shape, bool)
    measured[:4] = False
    surface = Published(
        *(field(u, v, start) for start in (1.5, 100, 1, 15)),
        measured,
        measured.astype(np.float32),
    )
    rig = Rig(lens, lens, np.eye(3), np.array([-0.2, 0, 0]))
    cloud = CloudBuilder(rig, grid, stride).cloud([surface])

    u, v = np.meshgrid(np.arange(0, WIDTH, stride), np.arange(0, HEIGHT, stride))
    dark, inside = v < 4 * grid.rows - 1, v > 4 * grid.rows
    # Beyond the outermost nodes the last values go on.
    inside &= (u > grid.pitch[0]) & (u < WIDTH - grid.pitch[0]) & (v < HEIGHT - grid.pitch[1])
    depth = 1 / field(u, v, 1.5)
    np.testing.assert_allclose(cloud.points[..., 2][inside], depth[inside], rtol=1e-5)
    np.testing.assert_allclose(
        cloud.points[..., 0][inside], (depth * (u - 105) / 200)[inside], atol=1e-5
    )
    np.testing.assert_allclose(cloud.intensity[inside], field(u, v, 100)[inside], rtol=1e-5)
    np.testing.assert_allclose(cloud.sigma[inside], field(u, v, 1)[inside], rtol=1e-5)
    expected = depth * field(u, v, 15) / 200
    np.testing.assert_allclose(cloud.resolution[inside], expected[inside], rtol=1e-5)
    for name in ('points', 'sigma', 'resolution'):
        assert np.isnan(getattr(cloud, name)[dark]).all(), name
    assert not cloud.intensity[dark].any()


def surface(left: int, right: int) -> Published:
    """One whose bins are measured from a column on, to before another."""
    measured = np.zeros((12, 30), bool)
    measured[:, left:right] = True
    node = np.zeros((12, 10), np.float32)
    return Published(node, node, node, node, measured, measured.astype(np.float32))


@pytest.mark.parametrize(('start', 'near'), [(14, True), (20, False)])
def test_surfaces_end_a_bin_before_each_other_and_nowhere_else(start, near):
    one, other = parted([surface(3, 12), surface(start, 27)], [NOTHING, NOTHING], (2, 4))
    assert np.flatnonzero(one.measured.any(axis=0)).tolist() == list(range(3, 12 - near))
    assert np.flatnonzero(other.measured.any(axis=0)).tolist() == list(range(start + near, 27))
    # What is left out is not taken back in as partly covered.
    assert one.covered[:, 11].any() != near
    assert other.covered[:, 26].all()


def test_a_surface_alone_is_whole():
    alone = surface(3, 12)
    (whole,) = parted([alone], [NOTHING], (2, 4))
    np.testing.assert_array_equal(whole.measured, alone.measured)


def test_of_bins_that_may_be_of_an_unpublished_surface_the_outermost_are_left_out():
    doubted = NOTHING.copy()
    doubted[3:6, 8:20] = True
    (left,) = parted([surface(3, 12)], [doubted], (2, 4))
    lost = surface(3, 12).measured & ~left.measured
    np.testing.assert_array_equal(np.argwhere(lost), [[3, 11], [4, 11], [5, 11]])
    assert not left.covered[lost].any()


def test_strips_are_no_surface_and_what_is_beside_one_is():
    lit = np.zeros((40, 60), bool)
    lit[10:30, 10:30] = lit[12:14, 30:50] = lit[36:38] = True
    found = surfaces_in(lit)
    assert found[10:30, 10:30].all()
    # A tip of the surface is its own as far as windows on it reach; a strip apart is none.
    np.testing.assert_array_equal(np.flatnonzero(found[12, 30:]), [0, 1, 2])
    assert found.sum() == 20 * 20 + 2 * 3
    assert not surfaces_in(lit & (np.arange(40)[:, None] > 32)).any()
