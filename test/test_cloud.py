import numpy as np
import pytest

from ftp_dent_ros.cloud import Cloud, read_ply, write_ply
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose


@pytest.fixture
def cloud():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(7, 11, 3)).astype(np.float32)
    points[rng.random((7, 11)) < 0.3] = np.nan
    intensity = np.where(np.isfinite(points[..., 2]), rng.random((7, 11)), 0)
    return Cloud(points, intensity.astype(np.float32))


def test_ply_keeps_the_grid_and_the_bits(cloud, tmp_path):
    path = tmp_path / 'cloud.ply'
    write_ply(path, cloud, 'camera_optical_frame')
    read, frame_id = read_ply(path)
    assert frame_id == 'camera_optical_frame'
    assert read.points.dtype == np.float32
    np.testing.assert_array_equal(read.points, cloud.points)
    np.testing.assert_array_equal(read.intensity, cloud.intensity)
    assert list(tmp_path.iterdir()) == [path]


def test_an_empty_cloud_is_written_and_read(tmp_path):
    empty = Cloud(np.full((2, 3, 3), np.nan, np.float32), np.zeros((2, 3), np.float32))
    write_ply(tmp_path / 'cloud.ply', empty, 'map')
    assert not read_ply(tmp_path / 'cloud.ply')[0].valid.any()


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


def damaged(data):
    yield 'empty', b'', 'not a PLY'
    yield 'text', b'hello\nend_header\n', 'not a PLY'
    yield 'cut', data[:-5], 'cut short'
    yield 'long', data + b'more', 'cut short'
    yield 'no grid', data.replace(b'obj_info num_cols 11\n', b''), 'organised'
    yield 'other fields', data.replace(b'property float intensity\n', b''), 'organised'
    yield 'small grid', data.replace(b'num_rows 7', b'num_rows 2'), 'outside its grid'


def test_damaged_files_are_refused(cloud, tmp_path):
    write_ply(tmp_path / 'cloud.ply', cloud, 'map')
    data = (tmp_path / 'cloud.ply').read_bytes()
    for name, content, said in damaged(data):
        path = tmp_path / f'{name}.ply'
        path.write_bytes(content)
        with pytest.raises(CloudError, match=said):
            read_ply(path)
    with pytest.raises(CloudError, match='cannot be read'):
        read_ply(tmp_path / 'none.ply')
