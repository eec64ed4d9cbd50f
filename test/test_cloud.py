import numpy as np
import pytest

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose


@pytest.fixture
def cloud():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(7, 11, 3)).astype(np.float32)
    points[rng.random((7, 11)) < 0.3] = np.nan
    intensity = np.where(np.isfinite(points[..., 2]), rng.random((7, 11)), 0)
    valid = np.isfinite(points[..., 2])
    sigma, resolution = (
        np.where(valid, rng.random((7, 11)), np.nan).astype(np.float32) for _ in range(2)
    )
    return Cloud(points, intensity.astype(np.float32), sigma, resolution)


def test_transformed(cloud):
    pose = Pose.from_rpy((0, 0, np.pi / 2), (10.0, 0, 0))
    moved = cloud.transformed(pose)
    x, y, z = np.moveaxis(cloud.points, -1, 0)
    expected = np.stack([10 - y, x, z], axis=-1)
    np.testing.assert_allclose(moved.points, expected, atol=1e-5)
    np.testing.assert_array_equal(moved.valid, cloud.valid)


@pytest.mark.parametrize(
    ('points', 'intensity'),
    [((77, 3), (77,)), ((7, 11, 2), (7, 11)), ((7, 11, 3), (7, 10))],
)
def test_shapes_are_checked(points, intensity):
    with pytest.raises(CloudError, match='shape'):
        Cloud(np.zeros(points, np.float32), np.zeros(intensity, np.float32))
    zeros = np.zeros((7, 11), np.float32)
    with pytest.raises(CloudError, match='sigma has the shape'):
        Cloud(np.zeros((7, 11, 3), np.float32), zeros, sigma=zeros[1:])
