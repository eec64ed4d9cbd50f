"""A recorded flight of the simulated payload, held against the simulated truth."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.ros.messages import cloud_from_message, stamp_to_ns
from ftp_dent_ros.simulation.world import World

TYPES = {
    '/camera/image_raw': Image,
    '/points': PointCloud2,
    '/tagged/points': PointCloud2,
    '/tagged/pose': PoseWithCovarianceStamped,
    '/mavlink/pose': PoseStamped,
}

# Every third point each way: the mean over a ninth of the points is the same to three digits.
_EVERY = 3
_MS_PER_NS = 1e-6
_MM_PER_M = 1e3


@dataclass(frozen=True)
class Appraisal:
    """Figures of one flight; counts of messages in the bag, milliseconds, millimetres.

    Attributes
    ----------
    images, clouds, tagged_clouds, poses : int
        What the bag holds; `tagged_clouds` counts those that have both cloud and pose.
    images_lost, poses_lost : int
        Holes in the count of the publisher: published, and not in the bag.
    tagged_clouds_late : int
        Clouds that came to the bridge when their poses were forgotten already.
    images_not_taken, poses_not_had : int
        Further gaps in the stamps at the rate that was asked for: the camera, or the autopilot
        and its link, could not keep up.
    clouds_lost, tagged_clouds_lost : int
        Images without a cloud; clouds without the same cloud in ``map`` and a pose.
    latency_median_ms, latency_maximum_ms : float
        From the middle of the exposure to the tagged cloud's arrival at the recorder.
    camera_mae_mm, camera_mae_worst_mm : float
        Mean distance of the clouds' points to the true skin in the camera's frame: over all
        clouds, and of the worst cloud.
    map_mae_mm, map_mae_worst_mm : float
        The same for the tagged clouds in ``map``, so with the pose's errors.
    """

    images: int
    images_lost: int
    images_not_taken: int
    clouds: int
    clouds_lost: int
    tagged_clouds: int
    tagged_clouds_lost: int
    tagged_clouds_late: int
    poses: int
    poses_lost: int
    poses_not_had: int
    latency_median_ms: float
    latency_maximum_ms: float
    camera_mae_mm: float
    camera_mae_worst_mm: float
    map_mae_mm: float
    map_mae_worst_mm: float


def appraise(
    bag: Bag,
    world: World,
    image_rate: float,
    pose_rate: float,
    progress: Callable[[], Any] = lambda: None,
) -> Appraisal:
    """Compare a bag with the world that it was recorded in.

    Parameters
    ----------
    bag : Bag
    world : World
        With the flight's start as it was flown.
    image_rate, pose_rate : float
        Rates that were asked of the camera and of the autopilot, hertz.
    progress : callable
        Called after each cloud.
    """
    stamps: dict[str, list[int]] = {topic: [] for topic in TYPES}
    counts: dict[str, list[int]] = {topic: [] for topic in TYPES}
    latencies: list[float] = []
    camera_errors: list[float] = []
    map_errors: list[float] = []
    for message in bag.messages(TYPES):
        content = deserialize_message(message.data, TYPES[message.topic])
        stamp_ns = stamp_to_ns(content.header.stamp)
        stamps[message.topic].append(stamp_ns)
        counts[message.topic].append(message.sequence)
        if message.topic == '/points':
            error = camera_error(world, cloud_from_message(content), stamp_ns, _EVERY)
            camera_errors.append(mean_absolute(error))
            progress()
        elif message.topic == '/tagged/points':
            latencies.append((message.log_time_ns - stamp_ns) * _MS_PER_NS)
            error = map_error(world, cloud_from_message(content), _EVERY)
            map_errors.append(mean_absolute(error))
            progress()
    late = _refused(bag, 'too old')
    images, clouds = set(stamps['/camera/image_raw']), set(stamps['/points'])
    tagged = set(stamps['/tagged/points']) & set(stamps['/tagged/pose'])
    poses = set(stamps['/mavlink/pose'])
    images_lost, poses_lost = (_holes(counts[t]) for t in ('/camera/image_raw', '/mavlink/pose'))
    nothing = float('nan')
    return Appraisal(
        images=len(images),
        images_lost=images_lost,
        images_not_taken=max(_gaps(images, image_rate) - images_lost, 0),
        clouds=len(clouds),
        clouds_lost=len(images - clouds),
        tagged_clouds=len(tagged),
        tagged_clouds_lost=max(len(clouds - tagged) - late, 0),
        tagged_clouds_late=late,
        poses=len(poses),
        poses_lost=poses_lost,
        poses_not_had=max(_gaps(poses, pose_rate) - poses_lost, 0),
        latency_median_ms=statistics.median(latencies) if latencies else nothing,
        latency_maximum_ms=max(latencies, default=nothing),
        camera_mae_mm=statistics.fmean(camera_errors) if camera_errors else nothing,
        camera_mae_worst_mm=max(camera_errors, default=nothing),
        map_mae_mm=statistics.fmean(map_errors) if map_errors else nothing,
        map_mae_worst_mm=max(map_errors, default=nothing),
    )


def clouds_of(bag: Bag, topic: str) -> Iterator[tuple[int, Cloud]]:
    """Stamps (ns) and clouds of a topic, in order."""
    for message in bag.messages([topic]):
        content = _content(message)
        yield stamp_to_ns(content.header.stamp), cloud_from_message(content)


def image_at(bag: Bag, stamp_ns: int) -> Image | None:
    """The camera's message with that stamp."""
    for message in bag.messages(['/camera/image_raw']):
        content = _content(message)
        if stamp_to_ns(content.header.stamp) == stamp_ns:
            return content
    return None


def camera_error(world: World, cloud: Cloud, stamp_ns: int, every: int = 1) -> NDArray[np.float64]:
    """Signed distance to the true skin of a cloud in the camera's frame, metres."""
    return world.seen_surface(stamp_ns).distance(cloud.points[::every, ::every])


def map_error(world: World, cloud: Cloud, every: int = 1) -> NDArray[np.float64]:
    """Signed distance to the true skin of a cloud in ``map``, metres."""
    return world.surface.distance(cloud.points[::every, ::every])


def mean_absolute(error: NDArray[np.float64]) -> float:
    """Mean absolute distance in millimetres; NaN of nothing."""
    measured = np.abs(error[np.isfinite(error)])
    return float(measured.mean()) * _MM_PER_M if measured.size else float('nan')


def _content(message: Message) -> Any:
    return deserialize_message(message.data, TYPES[message.topic])


def _refused(bag: Bag, reason: str) -> int:
    """How many clouds the bridge has refused for a reason, by the last that it told."""
    topic, count = '/diagnostics', 0
    if topic not in {each.name for each in bag.metadata.topics}:
        return 0
    for message in bag.messages([topic]):
        for status in deserialize_message(message.data, DiagnosticArray).status:
            if status.name.endswith('mavlink_bridge'):
                values = {item.key: item.value for item in status.values}
                count = max(count, int(values.get(f'refused: {reason}', 0)))
    return count


def _holes(counts: list[int]) -> int:
    """How many of a publisher's messages are missing between the first and the last."""
    return max(counts) - min(counts) + 1 - len(set(counts)) if counts else 0


def _gaps(stamps: set[int], rate: float) -> int:
    """How many stamps of a regular series are missing between its first and its last."""
    if len(stamps) < 2:
        return 0
    expected = round((max(stamps) - min(stamps)) * 1e-9 * rate) + 1
    return max(expected - len(stamps), 0)
