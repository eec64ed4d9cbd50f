import base64
import hashlib
import struct
import zlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import (
    STEP_UNKNOWN,
    RayGrid,
    decode,
    encode,
    thinned,
)
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens


def along_ray(before: Cloud, after: Cloud) -> np.ndarray:
    """Distances between points of two clouds, NaN where neither has one."""
    return np.linalg.norm(after.points.astype(float) - before.points.astype(float), axis=2)


def test_error_is_at_most_half_of_each_points_own_uncertainty(cloud, view):
    back = decode(encode(cloud, view))
    np.testing.assert_array_equal(back.valid, cloud.valid)
    # A coordinate of 0.8 m is itself known to 3e-8 m as a float32.
    assert np.nanmax(along_ray(cloud, back) - cloud.sigma / 2) < 1e-7


@pytest.mark.parametrize('distance', [0.25, 0.6, 1.5, 4.0])
def test_without_uncertainties_the_error_is_that_of_the_stated_step(view, cloud, distance):
    near = Cloud(cloud.points * np.float32(distance / 0.8), cloud.intensity)
    back = decode(encode(near, view))
    z = near.points[..., 2].astype(float)
    length = np.linalg.norm(near.points.astype(float), axis=2)
    bound = STEP_UNKNOWN / 2 * z * length + 2e-7 * length
    assert (along_ray(near, back)[near.valid] <= bound[near.valid]).all()
    assert np.isnan(back.sigma).all() and np.isnan(back.resolution).all()


def test_what_version_1_wrote_reads_the_same_on_every_machine():
    lens = Lens(8, 6, np.array([[10.0, 0, 3.5], [0, 10, 2.5], [0, 0, 1]]), np.full(5, 0.01))
    view = RayGrid(lens, 1)
    depth = 0.5 + 0.01 * np.arange(48).reshape(6, 8)
    points = np.stack([*view.rays() * depth, depth], axis=2)
    given = Cloud(points.astype('f4'), np.full((6, 8), 20, 'f4'))
    decoded = decode(base64.b64decode(WRITTEN))
    np.testing.assert_allclose(decoded.points, given.points, atol=1e-6)
    digest = hashlib.sha256(decoded.points.tobytes() + decoded.intensity.tobytes()).hexdigest()
    assert digest == 'dbfcdafac80e08e88d0dd18dd7a06df193744e6bf4941c9d030d24f06963ff4d'
    np.testing.assert_array_equal(decoded.points, decode(encode(given, view)).points)


WRITTEN = """
RkRDAacAeJyFz8EKgzAMBuB3yTmT1qHTvor0UDSDsFql7ZRNfPe1CLLDYIeE/8/hg2zgpzWAqhH6yT5Hl3KDsDCtoL
oGa5SiEMe6FhWWaVKWP5fUCKMJj2R0Mpc7kx1y28CZkUDBGxBCb2zO7BbygfIl0gyqpYu4HQIogTB7GriPPDlQMlVr
HGWsarGqsWz1jqfLLpILHF9fvmVHxp+8TC/8x2Wpd71/AFnLUTt4nPvPAAIABgABAHgBATAAz/8caVH3TUXV8aG+HM
zICIxIHV6uKs6UfILh5j6sMMx0Mm3cyMTI2Pgg+47SHnTSMp5lvBozeAG7GOJupa8iyR8VFuTr6eZkL2ZpZmKor6vd
q66moqyoIF8hIy0lKSEuvkZURERYSEgQABpjCcx4AXNmhABOBghgZ4AAVgYIYGGAAGYGCAAAEQwAZ3gB02AgDQAAB7
AAKWdbm+k=
"""


def test_a_cloud_off_the_rays_keeps_its_accuracy(cloud, view):
    pose = Pose(Rotation.from_euler('xyz', [0.3, 1.2, -2]), np.array([3.0, -2, 1]))
    moved = cloud.transformed(pose)
    back = decode(encode(moved, view))
    np.testing.assert_array_equal(back.valid, moved.valid)
    # As float32 a coordinate of 4 m is known to 2.4e-7 m only.
    assert np.nanmax(along_ray(moved, back) - moved.sigma / 2) < 1e-6


def test_a_preview_is_the_same_points_fewer(cloud, view):
    few, few_view = thinned(cloud, view, 80)
    assert few.intensity.shape == few_view.shape == (45, 80)
    back = decode(encode(few, few_view))
    assert np.nanmax(along_ray(few, back) - few.sigma / 2) < 1e-7
    np.testing.assert_array_equal(few.points, cloud.points[::4, ::4])


def test_damage_is_found_wherever_it_is(cloud, view):
    data = encode(*thinned(cloud, view, 40))
    rng = np.random.default_rng(5)
    for at in [0, 3, 4, 6, len(data) - 1, *rng.integers(0, len(data), 300)]:
        damaged = bytearray(data)
        damaged[at] ^= 1 << rng.integers(8)
        with pytest.raises(CodecError):
            decode(bytes(damaged))
    for size in [0, 1, 5, 6, 9, 100, len(data) - 1]:
        with pytest.raises(CodecError):
            decode(data[:size])
    with pytest.raises(CodecError):
        decode(data + b'\0')


@pytest.mark.parametrize(
    'header',
    [
        '[]', '{}', '"', '[' * 5000, '{"rows": 1e99, "columns": 1}',
        '{"rows": 100000, "columns": 100000, "view": null, "masks": [], "fields": []}',
        '{"rows": -1, "columns": -1, "view": null, "masks": [], "fields": []}',
        '{"rows": 2, "columns": 2, "view": [2], "masks": [1], "fields": [{}]}',
        '{"rows": 2, "columns": 2, "view": null, "masks": [], "fields": [{"name": "z"}]}',
        '{"rows": null, "columns": 2, "view": null, "masks": 3, "fields": 4}',
    ],
)  # fmt: skip
def test_headers_that_lie_are_refused(header):
    text = zlib.compress(header.encode())
    whole = b'FDC' + struct.pack('<BH', 1, len(text)) + text + b'xyz'
    with pytest.raises(CodecError):
        decode(whole + struct.pack('<I', zlib.crc32(whole)))


def test_another_version_is_named():
    whole = b'FDC' + struct.pack('<BH', 9, 0)
    with pytest.raises(CodecError, match=r'version 9.*knows 1'):
        decode(whole + struct.pack('<I', zlib.crc32(whole)))
