"""Between ROS messages and the package's arrays and dataclasses: all that a node needs of both."""

from __future__ import annotations

import sys
from array import array
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.images import image_from_message, photograph_from_message
from ftp_dent_ros.coding.messages import (
    CLOUD_FIELDS,
    cloud_from_message,
    covariance_from_message,
    lens_from_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Lens

if TYPE_CHECKING:
    from ftp_dent_ros.pose import Pose


__all__ = [
    'camera_info_message',
    'cloud_from_message',
    'cloud_to_message',
    'covariance_from_message',
    'covariant_pose_message',
    'image_from_message',
    'image_to_message',
    'lens_from_message',
    'make_header',
    'ns_to_stamp',
    'photograph_from_message',
    'pose_from_message',
    'pose_stamped_message',
    'pose_to_message',
    'stamp_to_ns',
]


def ns_to_stamp(nanoseconds: int) -> Time:
    """Stamp of a time in nanoseconds since the epoch of ROS time."""
    seconds, rest = divmod(int(nanoseconds), 1_000_000_000)
    return Time(sec=seconds, nanosec=rest)


def make_header(stamp_ns: int, frame_id: str) -> Header:
    """Header with a stamp in nanoseconds."""
    return Header(stamp=ns_to_stamp(stamp_ns), frame_id=frame_id)


def to_data(values: NDArray) -> array:
    """Bytes of an array in the one form that rclpy takes without looking at each of them.

    It takes 2 ms for 15 MB; ``bytes``, a list or an ndarray take 0.5 to 2 s.
    """
    data = array('B')
    data.frombytes(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
    return data


def cloud_to_message(cloud: Cloud, stamp_ns: int, frame_id: str) -> PointCloud2:
    """Organised sensor_msgs/PointCloud2 with the fields of a cloud, all float32."""
    rows, columns = cloud.intensity.shape
    # OpenCV interleaves four times as fast as NumPy.
    channels = [cloud.points, *(getattr(cloud, name) for name in CLOUD_FIELDS[3:])]
    values: Any = cv2.merge([np.asarray(each, np.float32) for each in channels])
    values = values.astype('<f4', copy=False)
    fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(CLOUD_FIELDS)
    ]
    return PointCloud2(
        header=make_header(stamp_ns, frame_id),
        height=rows,
        width=columns,
        fields=fields,
        is_bigendian=False,
        point_step=4 * len(CLOUD_FIELDS),
        row_step=4 * len(CLOUD_FIELDS) * columns,
        data=to_data(values),
        is_dense=False,
    )


def image_to_message(image: Photograph | NDArray[np.uint8], stamp_ns: int, frame_id: str) -> Image:
    """sensor_msgs/Image of a photograph, or rgb8 of RGB pixels, shape (height, width, 3).

    What has 10 to 14 bits is sent in the upper ones of 16, as drivers do: no encoding names them.
    """
    photograph = Photograph.of(image)
    pixels = photograph.pixels
    wide = pixels.dtype == np.uint16
    if wide and photograph.bits < 16:
        pixels = pixels << (16 - photograph.bits)
    kind = photograph.encoding.removesuffix(str(photograph.bits))
    return Image(
        header=make_header(stamp_ns, frame_id),
        height=photograph.height,
        width=photograph.width,
        encoding=f'{kind}{16 if wide else 8}',
        is_bigendian=sys.byteorder == 'big' and wide,
        step=pixels[0].nbytes,
        data=to_data(pixels),
    )


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
    given: dict[str, Any] = {}
    if lens:
        projection = np.hstack([lens.camera_matrix, np.zeros((3, 1))])
        given = {
            'distortion_model': 'plumb_bob',
            'd': lens.distortion.tolist(),
            'k': lens.camera_matrix.ravel(),
            'r': np.eye(3).ravel(),
            'p': projection.ravel(),
        }
    header = make_header(stamp_ns, frame_id)
    return CameraInfo(header=header, width=size[0], height=size[1], **given)


def pose_to_message(pose: Pose) -> PoseMessage:
    """geometry_msgs/Pose of a pose."""
    place = dict(zip('xyz', map(float, pose.translation), strict=True))
    turn = dict(zip('xyzw', map(float, pose.quaternion), strict=True))
    return PoseMessage(position=Point(**place), orientation=Quaternion(**turn))


def covariant_pose_message(
    pose: Pose, covariance: NDArray[Any], stamp_ns: int, frame_id: str
) -> PoseWithCovarianceStamped:
    """geometry_msgs/PoseWithCovarianceStamped of a pose in `frame_id`; covariance (6, 6)."""
    message = PoseWithCovarianceStamped(header=make_header(stamp_ns, frame_id))
    message.pose.pose = pose_to_message(pose)
    message.pose.covariance = covariance.ravel()
    return message


def pose_stamped_message(pose: Pose, stamp_ns: int, frame_id: str) -> PoseStamped:
    """geometry_msgs/PoseStamped of a pose in `frame_id`."""
    return PoseStamped(header=make_header(stamp_ns, frame_id), pose=pose_to_message(pose))
