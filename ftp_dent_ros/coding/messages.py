"""What messages hold, as the package's arrays and dataclasses.

Of rclpy's messages and of those that a bag gives without ROS (`recording.Bag.deserialise`) alike:
only their fields are asked for. Every function checks what it is given: a message may come from
any publisher.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.cloud.cloud import FIELDS, Cloud
from ftp_dent_ros.errors import CloudError, ConfigurationError, PoseError, RigError
from ftp_dent_ros.rig.rig import Lens

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import Pose as PoseMessage
    from sensor_msgs.msg import CameraInfo, PointCloud2

    from ftp_dent_ros.pose import Pose


CLOUD_FIELDS = ('x', 'y', 'z', *FIELDS)
#: Estimates of a dent: each is followed by its uncertainty.
ESTIMATES = (
    *('length', 'width', 'depth', 'model_length', 'model_width'),
    *('orientation', 'area', 'volume'),
)
_FLOATS = (
    *('x', 'y', 'z', 'normal_x', 'normal_y', 'normal_z', 'axis_x', 'axis_y', 'axis_z'),
    *(name for each in ESTIMATES for name in (each, f'{each}_uncertainty')),
    *('bottom_radius', 'clearance', 'position_uncertainty', 'significance'),
)
#: A dent as a point of a message: metres, radians, standard uncertainties.
DENT = np.dtype(
    [(name, '<f4') for name in _FLOATS]
    + [(name, '<u4') for name in ('number', 'kind', 'is_cut', 'sightings')]
)
# Of sensor_msgs/PointField: FLOAT32 and FLOAT64.
_FIELD_TYPES = {7: 'f4', 8: 'f8'}
# From a frame's origin, metres: farther out single precision is coarser than a millimetre.
FARTHEST = 1e4
# Of one photograph; four times the largest sensors.
_MOST_POINTS = 1 << 28
# Of a pose: a metre or radian that nobody knows better, squared, and what is no knowledge at all.
_SURE, _UNSURE_M, _UNSURE_RAD = 1e-12, 100.0, 6.3


def stamp_to_ns(stamp: Time) -> int:
    """Nanoseconds since the epoch of ROS time."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def cloud_from_message(message: PointCloud2) -> Cloud:
    """Cloud of a sensor_msgs/PointCloud2 whose fields lie at any offsets.

    Parameters
    ----------
    message : sensor_msgs/PointCloud2
        With float fields x, y, z; without the others intensity is 0, and the rest NaN.

    Raises
    ------
    CloudError
        A field is missing or of another type, the sizes do not agree, or the points cannot be.
    """
    height, width = message.height, message.width
    if not 0 < height * width <= _MOST_POINTS:
        raise CloudError(
            f'the point cloud has {width}x{height} points: publish one that a photograph gives'
        )
    order = '>' if message.is_bigendian else '<'
    fields = {
        field.name: field
        for field in message.fields
        if field.name in CLOUD_FIELDS and field.datatype in _FIELD_TYPES
    }
    if not {'x', 'y', 'z'} <= fields.keys():
        raise CloudError('the point cloud has no float fields x, y and z: publish them')
    try:
        line = width * message.point_step
        if message.row_step < line or len(message.data) < line:
            raise ValueError('rows overlap, or there is not one')
        point = np.dtype(
            {
                'names': list(fields),
                'formats': [order + _FIELD_TYPES[field.datatype] for field in fields.values()],
                'offsets': [field.offset for field in fields.values()],
                'itemsize': message.point_step,
            }
        )
        values: NDArray = np.ndarray(
            (height, width),
            point,
            memoryview(message.data),
            strides=(message.row_step, message.point_step),
        )
    except (ValueError, TypeError):
        raise CloudError(
            f'the point cloud of {width}x{height} points does not fit its {len(message.data)} '
            f'bytes, point_step {message.point_step} and row_step {message.row_step}: correct '
            'the publisher'
        ) from None
    points = np.empty((height, width, 3), np.float32)
    with np.errstate(over='ignore'):
        for index, axis in enumerate('xyz'):
            points[..., index] = values[axis]
    points = _checked_points(points)
    rest: dict[str, Any] = {
        name: values[name].astype(np.float32) for name in CLOUD_FIELDS[3:] if name in fields
    }
    rest.setdefault('intensity', np.zeros(points.shape[:2], np.float32))
    return Cloud(points, **rest)


def _checked_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Points of which none is known in part; raises `CloudError` if they cannot be."""
    # Plane by plane: reductions over an axis of three take several times as long.
    planes = [points[..., axis] for axis in range(3)]
    known = np.logical_and.reduce([np.isfinite(plane) for plane in planes])
    count = int(known.sum())
    if count < known.size:
        points[~known] = np.nan
    if count == 0:
        raise CloudError(
            f'none of the {known.size} points of the cloud is known: publish what was measured'
        )
    lowest = np.array([np.fmin.reduce(plane, axis=None) for plane in planes])
    highest = np.array([np.fmax.reduce(plane, axis=None) for plane in planes])
    farthest = float(max(highest.max(), -lowest.min()))
    if farthest > FARTHEST:
        raise CloudError(
            f"the point cloud has a point {farthest:.3g} m from its frame's origin, where single "
            f'precision holds no millimetre: publish it within {FARTHEST:g} m'
        )
    if count > 1 and (lowest == highest).all():
        raise CloudError(
            f'all {count} points of the cloud are in one place, '
            f'{lowest.tolist()}: publish what was measured'
        )
    return points


def dents_from_message(message: PointCloud2) -> NDArray:
    """Structured array of a message of the topics of dents, one `DENT` each.

    Raises
    ------
    CloudError
        It has other fields.
    """
    given = [(field.name, field.offset) for field in message.fields]
    expected = [(name, DENT.fields[name][1]) for name in DENT.names or ()]  # type: ignore[index]
    if given != expected or len(message.data) != message.width * DENT.itemsize:
        raise CloudError('the message holds no dents: give one of the topic dents')
    return np.frombuffer(message.data, DENT)


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


def pose_from_message(message: PoseMessage) -> Pose:
    """Pose of a geometry_msgs/Pose; raises `PoseError` if it is no pose."""
    # SciPy takes a second to load on a small computer, and most nodes have no poses.
    from ftp_dent_ros.pose import Pose

    position, orientation = message.position, message.orientation
    quaternion = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    translation = np.array([position.x, position.y, position.z])
    with np.errstate(over='ignore'):
        is_turn = abs(np.linalg.norm(quaternion) - 1) < 1e-3
    if not is_turn or not (np.abs(translation) <= FARTHEST).all():
        raise PoseError(
            f'the pose message holds the position {translation} and the quaternion {quaternion}, '
            'which is no pose: correct the publisher',
            'wrong pose',
        )
    return Pose.from_quaternion(quaternion, translation)


def covariance_from_message(values: ArrayLike) -> NDArray[np.float64]:
    """Covariance of a pose, shape (6, 6), as geometry_msgs has it; all zeros is unknown.

    What is not zeros has an inverse.

    Raises
    ------
    PoseError
        It is no covariance, or leaves the pose open: above 100 m or a whole turn.
    """
    covariance = np.array(values, float).reshape(6, 6)
    if not covariance.any():
        return covariance
    trouble = ''
    if not np.isfinite(covariance).all():
        trouble = 'is not finite'
    elif (np.abs(np.diag(covariance)) > np.repeat([_UNSURE_M**2, _UNSURE_RAD**2], 3)).any():
        trouble = f'is above {_UNSURE_M:g} m or a whole turn'
    elif not np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-9):
        trouble = 'is not symmetric'
    elif np.linalg.eigvalsh(covariance)[0] < -1e-6 * np.abs(covariance).max():
        trouble = 'is not positive'
    if trouble:
        raise PoseError(
            f"the pose's covariance {trouble}: correct the publisher, or leave all of it zero "
            'where it is not known',
            'wrong pose',
        )
    return (covariance + covariance.T) / 2 + _SURE * np.eye(6)


def message_class(type_name: str) -> type[Any]:
    """Class of a message type such as ``sensor_msgs/msg/Image``.

    Raises
    ------
    ConfigurationError
        Its package is not installed.
    """
    package, _, name = type_name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        raise ConfigurationError(
            f'{type_name}: this message type is not installed: install or source its package'
        ) from None
