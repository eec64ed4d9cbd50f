"""The clouds of a bag with all that the bag knows of each.

Its promise: a message that cannot be used costs its own cloud alone, named by topic and stamp.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.decoding.images import image_from_message
from ftp_dent_ros.decoding.messages import (
    cloud_from_message,
    covariance_from_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.errors import BagError, FtpDentError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.moved_cloud import pose_between
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.recording.topic import Message

POINTS, TAGGED, POSE = '/points', '/tagged/points', '/tagged/pose'
CAMERA_POSE = '/tagged/camera_pose'
SKIN = '/skin'
PHOTOGRAPHS = '/camera/image_raw'
_TYPES = {
    PHOTOGRAPHS: 'sensor_msgs/msg/Image',
    POINTS: 'sensor_msgs/msg/PointCloud2',
    TAGGED: 'sensor_msgs/msg/PointCloud2',
    POSE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
    CAMERA_POSE: 'geometry_msgs/msg/PoseWithCovarianceStamped',
    SKIN: 'sensor_msgs/msg/Image',
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
        Of the camera in `frame_id`, or of ``base_link`` where that alone was recorded.
    covariance : ndarray, shape (6, 6), or None
        Of that pose.
    photograph : ndarray, shape (height, width, 3), uint8, or None
        RGB.
    skin : ndarray, shape (rows, columns), uint8, or None
        Image of the skin on the cloud's grid, 0 where there is no point.
    """

    stamp_ns: int
    cloud: Cloud
    frame_id: str
    in_camera: bool
    pose: Pose | None = None
    vehicle: Pose | None = None
    covariance: NDArray[np.float64] | None = None
    photograph: NDArray[np.uint8] | None = None
    skin: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Skipped:
    """A message that could not be used.

    Attributes
    ----------
    topic : str
    stamp_ns : int
        Of its header; where that cannot be read, when it was received.
    reason : str
    """

    topic: str
    stamp_ns: int
    reason: str

    def __str__(self) -> str:
        return f'{self.topic} at {self.stamp_ns / 1e9:.3f} s: {self.reason}'


def count_clouds(bag: Bag) -> tuple[int, bool]:
    """How many clouds a bag has, and whether they are tagged with their poses.

    Raises
    ------
    BagError
        It has none.
    """
    counts = _counts(bag)
    wanted = _wanted(bag)
    return min(counts.get(topic, 0) for topic in wanted), len(wanted) > 1


def bag_clouds(
    bag: Bag,
    skip: Callable[[Skipped], object] = lambda skipped: None,
    photographs: bool = True,
) -> Iterator[BagCloud]:
    """Clouds of a bag in the order of their arrival: the tagged ones, else those of `POINTS`.

    Parameters
    ----------
    bag : Bag
    skip : callable
        Called with each message that cannot be used. A cloud or its pose costs that cloud, a
        photograph nothing else.
    photographs : bool
        Whether they are asked for.

    Raises
    ------
    BagError
        The bag has no clouds, or its file is damaged.
    """
    wanted = _wanted(bag)
    # With the camera's pose, nothing is asked of the tagged clouds, the largest of all messages.
    unused = {TAGGED, POSE} if CAMERA_POSE in wanted else set()
    unused |= set() if photographs else {PHOTOGRAPHS}
    topics = [topic for topic, count in _counts(bag).items() if count and topic not in unused]
    waiting: dict[int, dict[str, Any]] = {}
    done: set[int] = set()
    for message in bag.messages(topics):
        try:
            stamp_ns, content = _content(bag, message)
        except _UnusableError as error:
            skip(error.skipped)
            if error.stamp_ns is None:
                continue
            stamp_ns, content = error.stamp_ns, None
        if stamp_ns in done:
            if message.topic in wanted:
                skip(Skipped(message.topic, stamp_ns, 'is there a second time'))
            continue
        parts = waiting.setdefault(stamp_ns, {})
        parts[message.topic] = content
        if wanted <= parts.keys():
            del waiting[stamp_ns]
            done.add(stamp_ns)
            if all(parts[topic] is not None for topic in wanted):
                yield _bag_cloud(stamp_ns, parts)
        while len(waiting) > _LONGEST_WAIT:
            del waiting[next(iter(waiting))]


def _wanted(bag: Bag) -> frozenset[str]:
    """Topics that a cloud takes: with the camera's pose, else tagged, else alone."""
    counts = _counts(bag)
    for topics in ({POINTS, CAMERA_POSE}, {TAGGED, POSE}, {POINTS}):
        if all(counts.get(topic, 0) for topic in topics):
            return frozenset(topics)
    raise BagError(
        f'{bag.path}: has no clouds on {TAGGED} or {POINTS}: record them with the payload'
    )


def _counts(bag: Bag) -> dict[str, int]:
    """Messages of the topics that are asked for and have the type expected."""
    return {
        topic.name: bag.metadata.message_counts.get(topic.name, 0)
        for topic in bag.metadata.topics
        if topic.type == _TYPES.get(topic.name)
    }


class _UnusableError(Exception):
    def __init__(self, skipped: Skipped, stamp_ns: int | None) -> None:
        super().__init__(str(skipped))
        self.skipped, self.stamp_ns = skipped, stamp_ns


def _content(bag: Bag, message: Message) -> tuple[int, Any]:
    """Stamp of a message, and what it holds as the package's own."""
    stamp_ns = None
    try:
        if message.type != _TYPES[message.topic]:
            raise BagError(f'is a {message.type}, not a {_TYPES[message.topic]}')
        content = bag.deserialise(message)
        stamp_ns = stamp_to_ns(content.header.stamp)
        if message.topic == PHOTOGRAPHS:
            return stamp_ns, image_from_message(content)
        if message.topic == SKIN:
            return stamp_ns, image_from_message(content)[..., 0]
        if message.topic in (POSE, CAMERA_POSE):
            return stamp_ns, (*_located(content.pose), content.header.frame_id)
        return stamp_ns, (cloud_from_message(content), content.header.frame_id)
    except FtpDentError as reason:
        at_ns = message.log_time_ns if stamp_ns is None else stamp_ns
        skipped = Skipped(message.topic, at_ns, str(reason))
        raise _UnusableError(skipped, stamp_ns) from None


def _located(message: Any) -> tuple[Pose, NDArray[np.float64]]:
    return pose_from_message(message.pose), covariance_from_message(message.covariance)


def _bag_cloud(stamp_ns: int, parts: dict[str, Any]) -> BagCloud:
    photograph = parts.get(PHOTOGRAPHS)
    skin = parts.get(SKIN)
    for topic in (POINTS, TAGGED):
        if parts.get(topic) is not None:
            cloud, frame_id = parts[topic]
            parts[topic] = cloud.with_skin(skin), frame_id
    if parts.get(CAMERA_POSE) is not None and parts.get(POINTS) is not None:
        pose, covariance, frame_id = parts[CAMERA_POSE]
        cloud, _ = parts[POINTS]
        return BagCloud(stamp_ns, cloud, frame_id, True, pose, pose, covariance, photograph, skin)
    if parts.get(TAGGED) is None or parts.get(POSE) is None:
        cloud, frame_id = parts[POINTS]
        return BagCloud(stamp_ns, cloud, frame_id, True, photograph=photograph, skin=skin)
    placed, frame_id = parts[TAGGED]
    seen = None if parts.get(POINTS) is None else parts[POINTS][0]
    pose = None if seen is None else pose_between(seen, placed)
    vehicle, covariance, _ = parts[POSE]
    return BagCloud(
        stamp_ns=stamp_ns,
        cloud=placed if pose is None or seen is None else seen,
        frame_id=frame_id,
        in_camera=pose is not None,
        pose=pose,
        vehicle=vehicle,
        covariance=covariance,
        photograph=photograph,
        skin=skin,
    )
