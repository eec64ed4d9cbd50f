"""The picture of the skin: what is measured, where the points end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.unrolled import Unrolled

DOWN = Pose(Rotation.from_euler('x', np.pi), np.array([0.0, 0.0, 0.8]))
PLANE = Unrolled(
    np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), np.inf
)


def flat_cloud(spacing, width, height):
    """A plane seen from above, its points in the middles of squares."""
    x, y = (
        (np.arange(round(size / spacing)) + 0.5) * spacing - size / 2 for size in (width, height)
    )
    points = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), 0.8)], axis=-1)
    ones = np.ones(points.shape[:2], np.float32)
    return Cloud(points.astype(np.float32), ones, 1e-5 * ones)


@pytest.mark.parametrize('spacing', [0.0009, 0.0014, 0.0035])
def test_measured_is_what_the_points_stand_for(spacing):
    width, height = 0.2 - 0.2 % spacing, 0.13 - 0.13 % spacing
    mosaic = Mosaic(PLANE, np.full(2, -0.15), np.full(2, 0.15))
    light = np.full((round(height / spacing), round(width / spacing)), 90, np.uint8)
    # Askew, so that the rim falls on pixels in every way.
    pose = Pose(Rotation.from_euler('z', 0.4) * DOWN.rotation, DOWN.translation)
    mosaic.add(0, flat_cloud(spacing, width, height), pose, light, None)
    area = (mosaic.views > 0).sum() * 0.002**2
    # To less than a tenth of a pixel along the rim, and without holes.
    assert abs(area - width * height) < 0.0002 * 2 * (width + height)
    assert mosaic.views.max() == 1
    assert np.unique(mosaic.image).tolist() == [0, 90]


def test_a_hole_is_not_measured_and_a_cloud_beside_the_picture_leaves_no_trace():
    mosaic = Mosaic(PLANE, np.full(2, -0.15), np.full(2, 0.15))
    cloud = flat_cloud(0.001, 0.2, 0.12)
    cloud.points[40:80, 60:140] = np.nan
    mosaic.add(0, cloud, DOWN, None, None)
    assert not mosaic.measured()[15, 15] and mosaic.measured()[10, 15]
    before = mosaic.views.sum()
    mosaic.add(1, cloud, Pose(DOWN.rotation, np.array([1.0, 0, 0.8])), None, None)
    assert mosaic.views.sum() == before
