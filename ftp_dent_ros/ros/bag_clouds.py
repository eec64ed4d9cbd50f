"""The clouds of a bag with all that the bag knows of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.cloud import Cloud
from ftp_dent_ros.errors import BagError, ImageError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.ros.images import image_from_message
from ftp_dent_ros.ros.messages import cloud_from_message, pose_from_message, stamp_to_ns

POINTS, TAGGED, POSE = '/points', '/tagged/points', '/tagged/pose'
PHOTOGRAPHS = '/camera/image_raw'
_TYPES = {
    PHOTOGRAPHS: Image,
    POINTS: PointCloud2,
    TAGGED: PointCloud2,
    POSE: PoseWithCovarianceStamped,
}
# So many exposures may be under way at once: what belongs to older ones has not come.
_LONGEST_WAIT = 30


@dataclass(frozen=True, eq=False)
class BagCloud:
    """One cloud of a bag.

    Attributes
    ----------
    stamp_ns : int
    cloud : Cloud
        In the camera's frame if `in_camera`, else in `frame_id`.
    frame_id : str
        ``map`` of tagged clouds, else the camera's frame.
    in_camera : bool
    pose : Pose or None
        Of the camera in `frame_id`, where both clouds were recorded.
    vehicle : Pose or None
        Of ``base_link`` in `frame_id`.
    covariance : ndarray, shape (6, 6), or None
        Of that pose.
    photograph : ndarray, shape (height, width, 3), uint8, or None
        RGB.
    """

    stamp_ns: int
    cloud: Cloud
    frame_id: str
    in_camera: bool
    pose: Pose | None = None
    vehicle: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    photograph: NDArray[np.uint8] | None = None


def count_clouds(bag: Bag) -> tuple[int, bool]:
    """How many clouds a bag has, and whether they are tagged with their poses.

    Raises
    ------
    BagError
        It has none.
    """
    counts = bag.metadata.message_counts
    tagged = min(counts.get(TAGGED, 0), counts.get(POSE, 0))
    plain = counts.get(POINTS, 0)
    if not tagged and not plain:
        raise BagError(
            f'{bag.path}: has no clouds on {TAGGED} or {POINTS}: record them with the payload'
        )
    return tagged or plain, bool(tagged)


def bag_clouds(bag: Bag) -> Iterator[BagCloud]:
    """Clouds of a bag in the order of their arrival: the tagged ones, else those of `POINTS`."""
    _, tagged = count_clouds(bag)
    topics = [topic for topic in _TYPES if bag.metadata.message_counts.get(topic, 0)]
    waiting: dict[int, dict[str, Any]] = {}
    wanted = {TAGGED, POSE} if tagged else {POINTS}
    for message in bag.messages(topics):
        content = deserialize_message(message.data, _TYPES[message.topic])
        stamp_ns = stamp_to_ns(content.header.stamp)
        parts = waiting.setdefault(stamp_ns, {})
        parts[message.topic] = content
        if wanted <= parts.keys():
            del waiting[stamp_ns]
            yield _bag_cloud(stamp_ns, parts, tagged)
        while len(waiting) > _LONGEST_WAIT:
            del waiting[next(iter(waiting))]


def _bag_cloud(stamp_ns: int, parts: dict[str, Any], tagged: bool) -> BagCloud:
    photograph = None
    if PHOTOGRAPHS in parts:
        try:
            photograph = image_from_message(parts[PHOTOGRAPHS])
        except ImageError:
            photograph = None
    if not tagged:
        message = parts[POINTS]
        frame_id = message.header.frame_id
        return BagCloud(
            stamp_ns, cloud_from_message(message), frame_id, True, photograph=photograph
        )
    placed = cloud_from_message(parts[TAGGED])
    seen = cloud_from_message(parts[POINTS]) if POINTS in parts else None
    pose = None if seen is None else pose_between(seen, placed)
    located = parts[POSE].pose
    return BagCloud(
        stamp_ns=stamp_ns,
        cloud=placed if pose is None or seen is None else seen,
        frame_id=parts[TAGGED].header.frame_id,
        in_camera=pose is not None,
        pose=pose,
        vehicle=pose_from_message(located.pose),
        covariance=np.array(located.covariance, float).reshape(6, 6),
        photograph=photograph,
    )


def pose_between(seen: Cloud, placed: Cloud) -> Pose | None:
    """Pose that moved one cloud onto the other, or None if none did.

    Source: W. Kabsch, Acta Cryst. A32, 922 (1976).
    """
    if seen.points.shape != placed.points.shape:
        return None
    both = seen.valid & placed.valid
    if both.sum() < 3:
        return None
    a, b = seen.points[both].astype(float), placed.points[both].astype(float)
    middle_a, middle_b = a.mean(axis=0), b.mean(axis=0)
    u, _, vt = np.linalg.svd((b - middle_b).T @ (a - middle_a))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    pose = Pose(Rotation.from_matrix(turn), middle_b - turn @ middle_a)
    # Single precision at kilometres from the map's origin is not better.
    tolerance = 1e-5 + 1e-6 * float(np.abs(middle_b).max())
    return pose if np.abs(pose.apply(a) - b).mean() < tolerance else None
