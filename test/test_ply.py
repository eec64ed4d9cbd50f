"""Clouds as files."""

import re

import numpy as np
import pytest

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.ply import read_ply, write_ply
from ftp_dent_ros.errors import CloudError


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


def test_ply_keeps_the_grid_and_the_bits(cloud, tmp_path):
    path = tmp_path / 'cloud.ply'
    write_ply(path, cloud, 'camera_optical_frame')
    read, frame_id, _ = read_ply(path)
    assert frame_id == 'camera_optical_frame'
    assert read.points.dtype == np.float32
    np.testing.assert_array_equal(read.points, cloud.points)
    for name in ('intensity', 'sigma', 'resolution'):
        np.testing.assert_array_equal(getattr(read, name), getattr(cloud, name))
    assert list(tmp_path.iterdir()) == [path]


def test_ply_keeps_the_image_of_the_skin_where_there_is_one(cloud, tmp_path):
    path = tmp_path / 'cloud.ply'
    write_ply(path, cloud, 'map')
    assert b'skin' not in path.read_bytes().split(b'end_header')[0]
    assert not read_ply(path)[0].skin.any()
    skin = np.where(cloud.valid, np.arange(77).reshape(7, 11) + 1, 0).astype(np.uint8)
    write_ply(path, cloud.with_skin(skin), 'map')
    read, *_ = read_ply(path)
    assert read.skin.dtype == np.uint8
    np.testing.assert_array_equal(read.skin, skin)
    np.testing.assert_array_equal(read.sigma, cloud.sigma)


def test_a_cloud_says_which_rig_measured_it(cloud, tmp_path):
    for rig_id in ('', '0123456789ab'):
        write_ply(tmp_path / 'cloud.ply', cloud, 'map', rig_id)
        assert read_ply(tmp_path / 'cloud.ply')[1:] == ('map', rig_id)


def test_an_empty_cloud_is_written_and_read(tmp_path):
    empty = Cloud(np.full((2, 3, 3), np.nan, np.float32), np.zeros((2, 3), np.float32))
    write_ply(tmp_path / 'cloud.ply', empty, 'map')
    assert not read_ply(tmp_path / 'cloud.ply')[0].valid.any()


def test_a_frame_cannot_write_into_the_header(cloud, tmp_path):
    write_ply(tmp_path / 'cloud.ply', cloud, 'mäp\nelement face 9')
    assert read_ply(tmp_path / 'cloud.ply')[1] == 'm\\xe4p\\nelement face 9'


def damaged(data):
    yield 'empty', b'', 'not a PLY'
    yield 'text', b'hello\nend_header\n', 'not a PLY'
    yield 'cut', data[:-5], 'cut short'
    yield 'long', data + b'more', 'cut short'
    yield 'no grid', data.replace(b'obj_info num_cols 11\n', b''), 'organised'
    yield 'small grid', data.replace(b'num_rows 7', b'num_rows 6'), 'outside its grid'
    yield 'empty grid', data.replace(b'num_rows 7', b'num_rows 0'), 'no camera has'
    yield 'huge grid', data.replace(b'num_rows 7', b'num_rows 99999999'), 'no camera has'
    yield 'huge count', re.sub(rb'vertex \d+', b'vertex 99999999999999', data), 'no camera has'
    yield 'no number', data.replace(b'num_rows 7', b'num_rows 7.5'), 'organised'
    yield 'digits', data.replace(b'num_rows 7', b'num_rows ' + b'7' * 5000), 'organised'
    yield 'format', data.replace(b'binary_little', b'binary_middle'), 'format is not'
    yield 'list', data.replace(b'float z', b'list uchar int z'), 'organised'
    yield 'type', data.replace(b'float z', b'double z'), 'organised'
    yield 'endless header', data[:20] + b'comment x\n' * 10_000 + data[20:], 'not a PLY'


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
