"""Between ROS messages and the package's arrays and dataclasses.

Every function checks what it is given: a message may come from any publisher.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, NavSatFix, NavSatStatus, PointCloud2, PointField

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import CloudError, PoseError, RigError
from ftp_dent_ros.rig import Lens
from ftp_dent_ros.ros.fields import make_header, ns_to_stamp, stamp_to_ns, to_data
from ftp_dent_ros.ros.images import image_from_message, image_to_message

if TYPE_CHECKING:
    from ftp_dent_ros.navigation.geodesy import Origin
    from ftp_dent_ros.pose import Pose

__all__ = [
    'camera_info_message',
    'cloud_from_message',
    'cloud_to_message',
    'fix_message',
    'image_from_message',
    'image_to_message',
    'lens_from_message',
    'make_header',
    'ns_to_stamp',
    'pose_from_message',
    'pose_stamped_message',
    'pose_to_message',
    'stamp_to_ns',
]

_CLOUD_FIELDS = ('x', 'y', 'z', 'intensity')
_FIELD_TYPES = {PointField.FLOAT32: 'f4', PointField.FLOAT64: 'f8'}


def cloud_to_message(cloud: Cloud, stamp_ns: int, frame_id: str) -> PointCloud2:
    """Organised sensor_msgs/PointCloud2 with float32 x, y, z (metres) and intensity."""
    rows, columns = cloud.intensity.shape
    values = np.empty((rows, columns, 4), '<f4')
    values[..., :3] = cloud.points
    values[..., 3] = cloud.intensity
    fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(_CLOUD_FIELDS)
    ]
    return PointCloud2(
        header=make_header(stamp_ns, frame_id),
        height=rows,
        width=columns,
        fields=fields,
        is_bigendian=False,
        point_step=16,
        row_step=16 * columns,
        data=to_data(values),
        is_dense=False,
    )


def cloud_from_message(message: PointCloud2) -> Cloud:
    """Cloud of a sensor_msgs/PointCloud2 whose fields lie at any offsets.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
        With float fields x, y, z; intensity is 0 where there is no such field.

    Raises
    ------
    CloudError
        A field is missing or of another type, or the sizes do not agree.
    """
    order = '>' if message.is_bigendian else '<'
    offsets: dict[str, int] = {}
    formats: dict[str, str] = {}
    for field in message.fields:
        if field.name in _CLOUD_FIELDS and field.datatype in _FIELD_TYPES:
            offsets[field.name] = field.offset
            formats[field.name] = order + _FIELD_TYPES[field.datatype]
    if not {'x', 'y', 'z'} <= offsets.keys():
        raise CloudError('the point cloud has no float fields x, y and z: publish them')
    names = list(offsets)
    try:
        point = np.dtype(
            {
                'names': names,
                'formats': [formats[name] for name in names],
                'offsets': [offsets[name] for name in names],
                'itemsize': message.point_step,
            }
        )
        values: NDArray = np.ndarray(
            (message.height, message.width),
            point,
            memoryview(message.data),
            strides=(message.row_step, message.point_step),
        )
        if message.row_step < message.width * message.point_step:
            raise ValueError
    except (ValueError, TypeError):
        raise CloudError(
            f'the point cloud of {message.width}x{message.height} points does not fit its '
            f'{len(message.data)} bytes, point_step {message.point_step} and row_step '
            f'{message.row_step}: correct the publisher'
        ) from None
    points = np.stack([values[axis] for axis in 'xyz'], axis=-1).astype(np.float32)
    if 'intensity' in offsets:
        return Cloud(points, values['intensity'].astype(np.float32))
    return Cloud(points, np.zeros(points.shape[:2], np.float32))


def camera_info_message(
    lens: Lens | None, size: tuple[int, int], stamp_ns: int, frame_id: str
) -> CameraInfo:
    """sensor_msgs/CameraInfo of a lens, or of none (K is 0: uncalibrated).

    Parameters
    ----------
    lens : Lens or None
    size : (int, int)
        Width and height of the image that it goes with.
    stamp_ns : int
    frame_id : str

    Returns
    -------
    sensor_msgs/CameraInfo
        R is the identity and P is [K 0], as for a single camera.
    """
    message = CameraInfo(
        header=make_header(stamp_ns, frame_id),
        width=size[0],
        height=size[1],
    )
    if lens:
        message.distortion_model = 'plumb_bob'
        message.d = lens.distortion.tolist()
        message.k = lens.camera_matrix.ravel()
        message.r = np.eye(3).ravel()
        message.p = np.hstack([lens.camera_matrix, np.zeros((3, 1))]).ravel()
    return message


def lens_from_message(message: CameraInfo) -> Lens | None:
    """Lens of a sensor_msgs/CameraInfo, or None if it says that it is uncalibrated (K[0] = 0).

    Raises
    ------
    RigError
        The model is not plumb_bob, or a value is not finite or impossible.
    """
    matrix = np.array(message.k, float).reshape(3, 3)
    if matrix[0, 0] == 0:
        return None
    distortion = np.zeros(5)
    given = np.array(message.d, float)
    if message.distortion_model not in ('', 'plumb_bob') or len(given) > 5:
        raise RigError(
            f'camera_info has the distortion model {message.distortion_model!r} with '
            f'{len(given)} coefficients: only plumb_bob with up to 5 is known'
        )
    distortion[: len(given)] = given
    if not (np.isfinite(matrix).all() and np.isfinite(distortion).all()):
        raise RigError('camera_info holds numbers that are not finite: correct the publisher')
    if matrix[0, 0] < 0 or matrix[1, 1] <= 0 or not message.width or not message.height:
        raise RigError(
            'camera_info has no positive focal lengths or no image size: correct the publisher'
        )
    return Lens(message.width, message.height, matrix, distortion)


def pose_to_message(pose: Pose) -> PoseMessage:
    """geometry_msgs/Pose of a pose."""
    message = PoseMessage()
    position, orientation = message.position, message.orientation
    position.x, position.y, position.z = (float(value) for value in pose.translation)
    orientation.x, orientation.y, orientation.z, orientation.w = (
        float(value) for value in pose.quaternion
    )
    return message


def pose_from_message(message: PoseMessage) -> Pose:
    """Pose of a geometry_msgs/Pose; raises `PoseError` if it is no pose."""
    # SciPy takes a second to load on a small computer, and most nodes have no poses.
    from ftp_dent_ros.pose import Pose

    position, orientation = message.position, message.orientation
    quaternion = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    translation = np.array([position.x, position.y, position.z])
    if not abs(np.linalg.norm(quaternion) - 1) < 1e-3 or not np.isfinite(translation).all():
        raise PoseError(
            f'the pose message holds the position {translation} and the quaternion {quaternion}, '
            'which is no pose: correct the publisher',
            'wrong pose',
        )
    return Pose.from_quaternion(quaternion, translation)


def pose_stamped_message(pose: Pose, stamp_ns: int, frame_id: str) -> PoseStamped:
    """geometry_msgs/PoseStamped of a pose in `frame_id`."""
    return PoseStamped(header=make_header(stamp_ns, frame_id), pose=pose_to_message(pose))


def fix_message(origin: Origin, stamp_ns: int, frame_id: str) -> NavSatFix:
    """sensor_msgs/NavSatFix of the origin of the frame `frame_id`."""
    return NavSatFix(
        header=make_header(stamp_ns, frame_id),
        status=NavSatStatus(status=NavSatStatus.STATUS_FIX, service=NavSatStatus.SERVICE_GPS),
        latitude=origin.latitude,
        longitude=origin.longitude,
        altitude=origin.altitude,
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_UNKNOWN,
    )
