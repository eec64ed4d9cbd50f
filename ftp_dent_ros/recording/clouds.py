"""The clouds of a bag with all that the bag says of each.

A message that cannot be used costs its own cloud alone, named by topic and stamp.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

from ftp_dent_ros.cloud.coverage import NOTED_STAMP, Coverage
from ftp_dent_ros.cloud.seen import SeenCloud
from ftp_dent_ros.coding.images import image_from_message
from ftp_dent_ros.coding.messages import (
    cloud_from_message,
    covariance_from_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.errors import BagError, FtpDentError
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
_DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'


def count_clouds(bag: Bag) -> tuple[int, bool]:
    """How many clouds a bag has, and whether they are tagged with their poses.

    Raises
    ------
    BagError
        It has none.
    """
    wanted = _wanted(bag)
    return min(bag.message_counts[topic] for topic in wanted), len(wanted) > 1


def bag_clouds(
    bag: Bag,
    skip: Callable[[str], object] = lambda sentence: None,
    photographs: bool = True,
    unplaced: bool = False,
) -> Iterator[SeenCloud]:
    """Clouds of a bag in the order of their arrival: the tagged ones, else those of `POINTS`.

    Parameters
    ----------
    bag : Bag
    skip : callable
        Called with a sentence on each message that cannot be used. A cloud or its pose costs that
        cloud, a photograph nothing else.
    photographs : bool
        Whether they are asked for.
    unplaced : bool
        Whether clouds without a pose are, where others have one; else they are skipped.

    Raises
    ------
    BagError
        The bag has no clouds, or its file is damaged.
    """
    wanted = _wanted(bag)
    others = {SKIN, PHOTOGRAPHS} if photographs else {SKIN}
    topics = _recorded(bag) & (wanted | others)
    clouds, placed = wanted & {POINTS, TAGGED}, _placed(bag, wanted)
    waiting: dict[int, dict[str, Any]] = {}
    done: set[int] = set()
    for message in bag.messages(topics):
        stamp_ns, content = None, None
        try:
            if message.type != _TYPES[message.topic]:
                raise BagError(f'is a {message.type}, not a {_TYPES[message.topic]}')
            content = bag.deserialise(message)
            stamp_ns = stamp_to_ns(content.header.stamp)
            content = _usable(message, content)
        except FtpDentError as reason:
            at_ns = message.log_time_ns if stamp_ns is None else stamp_ns
            skip(f'{message.topic} at {at_ns / 1e9:.3f} s: {reason}')
            if stamp_ns is None:
                continue
            content = None
        if stamp_ns in done:
            if message.topic in wanted:
                skip(f'{message.topic} at {stamp_ns / 1e9:.3f} s: is there a second time')
            continue
        parts = waiting.setdefault(stamp_ns, {})
        parts[message.topic] = content
        is_placed = placed is None or stamp_ns in placed
        needed = wanted if is_placed else clouds
        if needed <= parts.keys():
            del waiting[stamp_ns]
            done.add(stamp_ns)
            if not (is_placed or unplaced):
                skip(f'{message.topic} at {stamp_ns / 1e9:.3f} s: has no pose')
            elif all(parts[topic] is not None for topic in needed):
                yield _seen_cloud(stamp_ns, parts)
        # So many exposures may be under way at once: what belongs to older ones has not come.
        while len(waiting) > 30:
            del waiting[next(iter(waiting))]


def rig_id_of(bag: Bag) -> str:
    """Id of the rig that measured a bag's clouds; empty if its diagnostics do not say it."""
    ids = (values.get('rig', 'none') for values in _diagnostics(bag))
    return next((rig_id for rig_id in ids if rig_id not in ('', 'none')), '')


def coverages_of(bag: Bag) -> dict[int, Coverage]:
    """Coverage of a bag's clouds by their stamps, nanoseconds.

    The diagnostics of ``reconstruction`` have that of the worst cloud of each second.
    """
    coverages = {}
    for values in _diagnostics(bag):
        stamp, coverage = values.get(NOTED_STAMP, ''), Coverage.noted(values)
        if coverage is not None and stamp.isdecimal():
            coverages[int(stamp)] = coverage
    return coverages


def _diagnostics(bag: Bag) -> Iterator[dict[str, str]]:
    """What the nodes of a bag said of themselves, by name, each time."""
    topics = [topic.name for topic in bag.topics if topic.type == _DIAGNOSTICS]
    for message in bag.messages(topics):
        if message.type == _DIAGNOSTICS:
            for status in bag.deserialise(message).status:
                yield {str(item.key): str(item.value) for item in status.values}


def _wanted(bag: Bag) -> frozenset[str]:
    """Topics that a cloud takes: with the camera's pose, else tagged, else alone."""
    recorded = _recorded(bag)
    for topics in ({POINTS, CAMERA_POSE}, {TAGGED, POSE}, {POINTS}):
        if topics <= recorded:
            return frozenset(topics)
    raise BagError(
        f'{bag.path}: has no clouds on {TAGGED} or {POINTS}: record them with the payload'
    )


def _placed(bag: Bag, wanted: frozenset[str]) -> set[int] | None:
    """Stamps of the poses, where some clouds may have none."""
    poses = wanted - {POINTS, TAGGED}
    if not poses or len({bag.message_counts[topic] for topic in wanted}) == 1:
        return None
    stamps = set()
    for message in bag.messages(poses):
        with suppress(FtpDentError):
            stamps.add(stamp_to_ns(bag.deserialise(message).header.stamp))
    return stamps


def _recorded(bag: Bag) -> set[str]:
    """Topics that are asked for, have the type expected, and messages."""
    return {
        topic.name
        for topic in bag.topics
        if topic.type == _TYPES.get(topic.name) and bag.message_counts[topic.name]
    }


def _usable(message: Message, content: Any) -> Any:
    """What a message holds, as the package's own."""
    if message.topic == PHOTOGRAPHS:
        return image_from_message(content)
    if message.topic == SKIN:
        return image_from_message(content)[..., 0]
    frame_id = content.header.frame_id
    if message.topic in (POSE, CAMERA_POSE):
        covariance = covariance_from_message(content.pose.covariance)
        return pose_from_message(content.pose.pose), covariance, frame_id
    return cloud_from_message(content), frame_id


def _seen_cloud(stamp_ns: int, parts: dict[str, Any]) -> SeenCloud:
    in_camera = TAGGED not in parts
    cloud, frame_id = parts[POINTS if in_camera else TAGGED]
    located = parts.get(CAMERA_POSE if in_camera else POSE)
    vehicle, covariance, frame = located or (None, None, frame_id)
    return SeenCloud(
        f'{stamp_ns / 1e9:.3f} s',
        cloud.with_skin(parts.get(SKIN)),
        stamp_ns,
        frame if in_camera else frame_id,
        in_camera,
        pose=vehicle if in_camera else None,
        vehicle=vehicle,
        covariance=covariance,
        photograph=parts.get(PHOTOGRAPHS),
    )
