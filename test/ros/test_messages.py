from __future__ import annotations

from array import array

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError, ImageError, PoseError, RigError
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.messages import (
    camera_info_message,
    cloud_from_message,
    cloud_to_message,
    covariance_from_message,
    image_from_message,
    image_to_message,
    lens_from_message,
    photograph_from_message,
    pose_from_message,
    pose_to_message,
)

RNG = np.random.default_rng(3)
RGB = RNG.integers(0, 256, (4, 6, 3), np.uint8)


def through_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def image_message(pixels: np.ndarray, encoding: str, padding: int = 0, **fields) -> Image:
    height, width = pixels.shape[:2]
    lines = np.ascontiguousarray(pixels).reshape(height, -1).view(np.uint8)
    lines = np.pad(lines, ((0, 0), (0, padding)), constant_values=99)
    message = Image(height=height, width=width, encoding=encoding, step=lines.shape[1], **fields)
    message.data = array('B', lines.tobytes())
    return message


ALPHA = np.full((4, 6, 1), 7, np.uint8)
WIDE = RGB.astype(np.uint16) * 256 + 255 - RGB


@pytest.mark.parametrize('padding', [0, 5])
@pytest.mark.parametrize(
    ('pixels', 'encoding', 'big'),
    [
        (RGB, 'rgb8', 0),
        (RGB[..., ::-1], 'bgr8', 0),
        (np.concatenate([RGB, ALPHA], -1), 'rgba8', 1),
        (np.concatenate([RGB[..., ::-1], ALPHA], -1), 'bgra8', 0),
        (WIDE.astype('<u2'), 'rgb16', 0),
        (WIDE.astype('>u2'), 'rgb16', 1),
        (WIDE[..., ::-1].astype('>u2'), 'bgr16', 1),
    ],
)
def test_every_order_of_colours_is_read(pixels, encoding, big, padding):
    message = image_message(pixels, encoding, padding, is_bigendian=big)
    message = through_the_wire(message)
    read = photograph_from_message(message)
    deep = encoding.endswith('16')
    np.testing.assert_array_equal(read.pixels, WIDE if deep else RGB)
    np.testing.assert_allclose(image_from_message(message), RGB, atol=int(deep))


@pytest.mark.parametrize(
    ('bits', 'mosaic', 'encoding'),
    [
        (8, '', 'mono8'),
        (12, '', 'mono16'),
        (10, 'gbrg', 'bayer_gbrg16'),
        (16, 'rggb', 'bayer_rggb16'),
    ],
)
def test_raw_pixels_keep_every_bit_on_the_way(bits, mosaic, encoding):
    kind = np.uint8 if bits == 8 else np.uint16
    pixels = np.random.default_rng(0).integers(0, 1 << bits, (6, 8)).astype(kind)
    message = through_the_wire(image_to_message(Photograph.of(pixels, mosaic, bits), 1, 'eye'))
    assert message.encoding == encoding
    back = photograph_from_message(message)
    assert back.mosaic == mosaic
    shift = 0 if bits == 8 else 16 - bits
    np.testing.assert_array_equal(back.pixels >> shift, pixels)


@pytest.mark.parametrize(('encoding', 'luma'), [('yuv422_yuy2', 0), ('uyvy', 1)])
def test_packed_yuv_is_read(encoding, luma):
    packed = np.full((4, 6, 2), 128, np.uint8)
    packed[..., luma] = 126
    image = image_from_message(image_message(packed, encoding))
    assert image.shape == (4, 6, 3)
    assert np.ptp(image) == 0 and abs(int(image[0, 0, 0]) - 128) <= 2


@pytest.mark.parametrize(
    ('change', 'word'),
    [
        ({'encoding': 'jpeg'}, 'encoding'),
        ({'height': 0}, 'bytes'),
        ({'width': 0}, 'bytes'),
        ({'width': 2**32 - 1, 'step': 2**32 - 1}, 'bytes'),
        ({'step': 17}, 'bytes'),
        ({'data': array('B', bytes(71))}, 'bytes'),
    ],
)
def test_an_impossible_image_is_refused(change, word):
    message = image_to_message(RGB, 0, '')
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(ImageError, match=word):
        image_from_message(message)


def sample_cloud(rows: int = 3, columns: int = 5) -> Cloud:
    points = RNG.normal(size=(rows, columns, 3)).astype(np.float32)
    points[0, 1] = np.nan
    return Cloud(points, RNG.uniform(0, 255, (rows, columns)).astype(np.float32))


def test_a_cloud_comes_back_bit_for_bit():
    cloud = sample_cloud()
    message = through_the_wire(cloud_to_message(cloud, 5, 'eye'))
    assert (message.height, message.width, message.is_dense) == (3, 5, False)
    names = ['x', 'y', 'z', 'intensity', 'sigma', 'resolution', 'raw', 'noise']
    assert [field.name for field in message.fields] == names
    back = cloud_from_message(message)
    np.testing.assert_array_equal(back.points.view(np.uint32), cloud.points.view(np.uint32))
    np.testing.assert_array_equal(back.intensity, cloud.intensity)


@pytest.mark.parametrize('order', ['<', '>'])
def test_a_cloud_of_another_layout_is_read(order):
    """As PCL writes it: 16 bytes for the position, 32 a point, padded rows, doubles, a colour."""
    cloud = sample_cloud()
    point = np.dtype(
        {
            'names': ['z', 'x', 'y', 'rgb'],
            'formats': [f'{order}f8', f'{order}f4', f'{order}f4', f'{order}u4'],
            'offsets': [8, 0, 4, 20],
            'itemsize': 32,
        }
    )
    values = np.zeros((3, 6), point)
    for axis, name in enumerate('xyz'):
        values[name][:, :5] = cloud.points[..., axis]
    message = PointCloud2(
        height=3,
        width=5,
        point_step=32,
        row_step=6 * 32,
        is_bigendian=order == '>',
        data=array('B', values.tobytes()),
    )
    types = {'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64, 'u4': PointField.UINT32}
    message.fields = [
        PointField(name=name, offset=offset, datatype=types[kind[0].str[1:]], count=1)
        for name, kind in point.fields.items()
        for offset in [kind[1]]
    ]
    back = cloud_from_message(through_the_wire(message))
    np.testing.assert_array_equal(back.points, cloud.points)
    assert not back.intensity.any()


@pytest.mark.parametrize(
    'change',
    [
        {'width': 6},
        {'height': 2**32 - 1, 'width': 2**32 - 1},
        {'point_step': 8},
        {'row_step': 10},
        {'data': array('B', bytes(10))},
        {'fields': []},
        {'fields': [PointField(name=name, offset=2**31, datatype=7) for name in 'xyz']},
        {'fields': [PointField(name=name, offset=0, datatype=2) for name in 'xyz']},
    ],
)
def test_an_impossible_cloud_is_refused(change):
    message = cloud_to_message(sample_cloud(), 0, '')
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(CloudError):
        cloud_from_message(message)


MATRIX = np.array([[900.0, 0, 321.5], [0, 905, 239], [0, 0, 1]])
LENS = Lens(640, 480, MATRIX, np.array([0.1, -0.02, 1e-3, 2e-3, 0.003]))


def test_camera_info_holds_the_lens():
    message = through_the_wire(camera_info_message(LENS, (640, 480), 7, 'eye'))
    assert message.p[2] == 321.5 and message.r[4] == 1
    lens = lens_from_message(message)
    assert lens is not None and (lens.width, lens.height) == (640, 480)
    np.testing.assert_array_equal(lens.camera_matrix, MATRIX)
    np.testing.assert_array_equal(lens.distortion, LENS.distortion)


@pytest.mark.parametrize(
    'change',
    [
        {'k': np.full(9, np.nan)},
        {'k': -MATRIX.ravel()},
        {'d': [float('inf')] * 5},
        {'d': [0.0] * 8},
        {'distortion_model': 'equidistant'},
        {'width': 0},
    ],
)
def test_an_impossible_camera_info_is_refused(change):
    message: CameraInfo = camera_info_message(LENS, (640, 480), 7, 'eye')
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(RigError, match='camera_info'):
        lens_from_message(message)


def test_a_pose_comes_back():
    pose = Pose.from_rpy([0.1, -0.2, 3.0], [1.0, 2.0, -3.0])
    back = pose_from_message(through_the_wire(pose_to_message(pose)))
    np.testing.assert_allclose(back.translation, pose.translation)
    assert (back.rotation.inv() * pose.rotation).magnitude() < 1e-12


@pytest.mark.parametrize(('name', 'value'), [('w', 0.0), ('x', float('nan'))])
def test_an_impossible_pose_is_refused(name, value):
    message = pose_to_message(Pose.from_rpy([0, 0, 0], [0, 0, 0]))
    setattr(message.orientation, name, value)
    with pytest.raises(PoseError):
        pose_from_message(message)


def test_points_that_are_known_in_part_are_not_known():
    cloud = sample_cloud()
    cloud.points[1, 2] = (np.inf, 0.1, 0.2)
    cloud.points[2, 3] = (0.1, np.nan, 0.2)
    taken = cloud_from_message(cloud_to_message(cloud, 0, ''))
    assert np.isnan(taken.points[[0, 1, 2], [1, 2, 3]]).all()
    assert taken.valid.sum() == cloud.valid.size - 3


@pytest.mark.parametrize(
    ('points', 'words'),
    [
        (np.zeros((3, 5, 3), np.float32), 'all 15 points of the cloud are in one place'),
        (np.full((3, 5, 3), 1e5, np.float32), '1e[+]05 m from its frame'),
        (np.linspace(0, 3e38, 45, dtype=np.float32).reshape(3, 5, 3), 'holds no millimetre'),
    ],
)
def test_points_that_cannot_be_are_refused(points, words):
    cloud = Cloud(points, np.zeros((3, 5), np.float32))
    with pytest.raises(CloudError, match=words):
        cloud_from_message(cloud_to_message(cloud, 0, ''))


@pytest.mark.parametrize(
    ('covariance', 'words'),
    [
        (np.full((6, 6), np.nan), 'is not finite'),
        (np.eye(6) * 1e300, 'is above 100 m or a whole turn'),
        (-np.eye(6), 'is not positive'),
        (np.eye(6) + np.eye(6, k=1), 'is not symmetric'),
        (np.ones((6, 6)) - np.eye(6), 'is not positive'),
    ],
)
def test_what_is_no_covariance_is_refused(covariance, words):
    with pytest.raises(PoseError, match=words):
        covariance_from_message(covariance.ravel())
