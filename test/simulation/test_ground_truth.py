"""What a simulated photograph truly shows, pixel by pixel."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from ground_truth import EDGES, ground_truth
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Paint, Panel, Renderer, Sunlight, Surface

WIDE = (-0.5, 0.5, -0.5, 0.5)


def flat(distance=0.6, extent=WIDE, **options):
    return Panel(Pose(Rotation.identity(), np.array([0, 0, distance])), extent, **options)


@pytest.fixture
def truth_of(rig, pattern, noiseless):
    def truth(*panels, stride=1, **light):
        photometry = dataclasses.replace(noiseless, **light)
        renderer = Renderer(rig, pattern.draw(), photometry)
        return ground_truth(renderer, Surface(panels), pattern.period_px, stride)

    return truth


def test_a_plane_is_at_its_depth_and_its_only_edge_is_the_rim(truth_of, rig):
    truth = truth_of(flat(), stride=2)
    assert truth.depth.shape == (32, 48)
    np.testing.assert_allclose(truth.depth, 0.6)
    rays = rig.camera.rays(rig.camera.pixel_grid(2))
    np.testing.assert_allclose(truth.along_ray, np.linalg.norm(rays, axis=-1))
    assert truth.lit.all()
    assert not truth.clipped.any()
    for name in EDGES[:-1]:
        assert np.isinf(truth.edges[name]).all(), name
    assert truth.edges['rim'][0].max() == 0
    # Pixels a fringe: those between columns that the projector's light moves by a period.
    period = 2 * 8 / np.abs(np.diff(truth.u_p, axis=1))
    np.testing.assert_allclose(truth.period[:, :-1], period, rtol=0.03)
    middle = truth.edges['rim'][16, 24]
    assert middle == pytest.approx(31 / truth.period[16, 24], rel=0.1)


def test_edges_of_each_kind_are_where_they_are(truth_of):
    """Of depth, sun and paint at x = 3 mm: there, and as many fringes away as they are."""
    scenes = SimpleNamespace(
        depth=(flat(extent=(-0.5, 0.003, -0.5, 0.5)), flat(0.602)),
        shadow=(flat(sunlight=(Sunlight(0.5, (1, 0, 0.003)),)),),
        albedo=(flat(paint=Paint(edge=(1, 0, 0.003), albedo_beyond=(0.3,) * 3)),),
    )
    for name, panels in vars(scenes).items():
        truth = truth_of(*panels, exposure=0.5)
        row = truth.edges[name][30] * truth.period[30]
        x = np.linspace(0, 95, 96)
        (edge,) = np.flatnonzero(row == 0)[:1]
        assert 49 <= edge <= 54, name
        np.testing.assert_allclose(row[edge + 5 :], x[edge + 5 :] - edge, atol=2.5)
        others = set(EDGES) - {name, 'rim', 'depth', 'shadow'}
        assert all(np.isinf(truth.edges[other]).all() for other in others)


def test_what_is_clipped_has_an_edge(truth_of):
    truth = truth_of(flat(), exposure=1.6)
    assert 0.1 < truth.clipped.mean() < 0.9
    assert truth.edges['clipping'][~truth.clipped].min() <= 0.2
    assert truth.nearest_edge.max() < 1
