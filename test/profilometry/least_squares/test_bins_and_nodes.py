import numpy as np
import pytest

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid

PERIODS = (5.0, 7.7, 11.7, 16.0)


@pytest.fixture(params=PERIODS)
def grid(request):
    return Grid.for_fringes(203, 118, request.param)


def test_a_plane_stays_a_plane(grid):
    v, u = np.mgrid[: grid.height, : grid.width]
    plane = np.rint(20 + 0.5 * u + 0.25 * v).astype(np.uint8)
    bins = grid.binned(plane)
    assert bins.shape == grid.bin_shape
    columns, rows = np.meshgrid(*grid.bin_positions())
    inside = (slice(None, -1), slice(3 * grid.bins, -3 * grid.bins))
    np.testing.assert_allclose(bins[inside], (20 + 0.5 * columns + 0.25 * rows)[inside], atol=0.3)
    nodes = grid.at_nodes((0.5 * columns).astype(np.float32))
    expected = 0.5 * np.tile(grid.node_positions()[0], (grid.shape[0], 1))
    assert nodes.shape == grid.shape
    np.testing.assert_allclose(nodes[:, 2:-2], expected[:, 2:-2], atol=1e-3)


@pytest.mark.parametrize('first', [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_lattice_has_the_bins_of_its_plane(grid, first):
    v, u = np.mgrid[: grid.height, : grid.width]
    plane = (2000 + 50 * u + 25 * v).astype(np.uint16)
    elsewhere = np.ones(plane.shape, bool)
    elsewhere[first[0] :: 2, first[1] :: 2] = False
    plane[elsewhere] = 65535
    bins = grid.binned_lattice(plane, *first)
    columns, rows = np.meshgrid(*grid.bin_positions())
    inside = (slice(1, -2), slice(3 * grid.bins, -3 * grid.bins))
    expected = 2000 + 50 * columns + 25 * rows
    np.testing.assert_allclose(bins[inside], expected[inside], atol=1.0)


@pytest.mark.parametrize('first', [(0, 0), (0, 1), (1, 0), (1, 1)])
@pytest.mark.parametrize('period', [7.7, 9.7, 12.3])
def test_a_lattice_does_not_move_the_fringes(first, period):
    grid = Grid.for_fringes(800, 24, period)
    turn = 2 * np.pi / period
    level = 20000 + 10000 * np.cos(turn * np.arange(800))
    bins = grid.binned_lattice(np.tile(np.rint(level).astype(np.uint16), (24, 1)), *first)
    columns = grid.bin_positions()[0]
    window = np.hanning(len(columns))
    phase = np.angle((window * (bins[0] - 20000)) @ np.exp(-1j * turn * columns))
    # By every second pixel's averages alone: 0.004.
    assert abs(phase) < 3e-4


def test_nodes_are_interpolated_and_extrapolated_to_the_bins(grid):
    columns, _ = grid.node_positions()
    nodes = np.tile(columns, (grid.shape[0], 1)).astype(np.float32)
    np.testing.assert_allclose(grid.at_bins(nodes)[3], grid.bin_positions()[0], atol=1e-2)
    assert (np.diff(grid.to_bins(nodes)[0]).reshape(-1)[: grid.bins - 1] == 0).all()


def test_noise_is_what_the_averages_leave_of_it(grid):
    rng = np.random.default_rng(0)
    pixels = np.rint(128 + 20 * rng.standard_normal((grid.height * 4, grid.width))).astype(
        np.uint8
    )
    tall = Grid(grid.width, grid.height * 4, grid.step, grid.bins, grid.rows)
    bins = tall.binned(pixels)[:-1, 12:-12] - 128
    variance, density = tall.noise_at(PERIODS[-1] / grid.step)
    assert bins.var() / 400 == pytest.approx(variance, rel=0.12)
    assert (density == pytest.approx(1.0)) == (grid.step == 1)
