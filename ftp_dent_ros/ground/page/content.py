"""What the items of the link hold, without ROS."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ftp_dent_ros.dents.dent import KINDS
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.item import Item
from ftp_dent_ros.pose import Pose

_LARGEST = 4 << 20  # bytes of a message


def message_of(item: Item) -> Any:
    """Message of CDR, without ROS."""
    from ftp_dent_ros.recording.definitions import typestore

    try:
        if len(item.data) > _LARGEST:
            raise ValueError
        return typestore().deserialize_cdr(item.data, item.kind.removeprefix('cdr:'))
    except Exception:
        raise CodecError(f'an item of {item.topic} holds no message: it is refused') from None


def pose_of(message: Any) -> Pose:
    """Pose of a PoseWithCovarianceStamped."""
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    return Pose.from_quaternion(
        [turn.x, turn.y, turn.z, turn.w], [position.x, position.y, position.z]
    )


def path_of(message: Any) -> tuple[int, list[list[float]]]:
    """Stamp of a Path (ns), and its places, metres."""
    places = [each.pose.position for each in message.poses]
    return _stamp(message.header), [_rounded([at.x, at.y, at.z]) for at in places]


def coverage_of(message: Any) -> tuple[int, dict[str, list[list[list[float]]]]]:
    """Stamp of a coverage (ns), and its strips: ``measured`` and ``gaps``, four corners each."""
    strips: dict[str, list[list[list[float]]]] = {'measured': [], 'gaps': []}
    for marker in message.markers:
        if marker.ns in strips:
            corners = [_rounded([at.x, at.y, at.z]) for at in marker.points]
            # Two triangles each: of the second only the last corner is another.
            strips[marker.ns] = [
                [*corners[i : i + 3], corners[i + 5]] for i in range(0, len(corners) - 5, 6)
            ]
    return _stamp(message.markers[0].header), strips


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def _rounded(place: list[float]) -> list[float]:
    if not all(map(math.isfinite, place)):
        raise ValueError
    return [round(value, 3) for value in place]


def dents_of(message: Any) -> list[dict[str, Any]]:
    """Dents of a message of dents/list: lengths in millimetres, places in metres."""
    kinds = {7: '<f4', 6: '<u4'}  # sensor_msgs/PointField
    row = np.dtype(
        {
            'names': [field.name for field in message.fields],
            'formats': [kinds[field.datatype] for field in message.fields],
            'offsets': [field.offset for field in message.fields],
            'itemsize': message.point_step,
        }
    )
    values = np.frombuffer(bytes(message.data), row)[:1000]
    return [_dent(value) for value in values]


def _dent(value: Any) -> dict[str, Any]:
    def number(name: str, factor: float = 1.0, digits: int = 4) -> float | None:
        given = float(value[name]) * factor
        return round(given, digits) if math.isfinite(given) else None

    def vector(name: str) -> list[float | None]:
        return [number(f'{name}{axis}') for axis in 'xyz']

    lengths = ('length', 'width', 'depth')
    return {
        'number': int(value['number']),
        'kind': KINDS[int(value['kind'])],
        'place': vector(''),
        'normal': vector('normal_'),
        'axis': vector('axis_'),
        'sightings': int(value['sightings']),
        **{f'{name}_mm': number(name, 1e3, 3) for name in lengths},
        **{f'{name}_uncertainty_mm': number(f'{name}_uncertainty', 1e3, 3) for name in lengths},
    }
