"""What a flight measured against the truth of its scene: clouds, skin and dents."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.inspection.report import InspectionReport
from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.messages import cloud_from_message, stamp_to_ns
from ftp_dent_ros.simulation.truth import TrueDent, true_dents, true_index
from ftp_dent_ros.simulation.world import World
from ftp_dent_ros.survey.joining import Joining

TYPES = {
    '/camera/image_raw': Image,
    '/points': PointCloud2,
    '/tagged/points': PointCloud2,
    '/tagged/pose': PoseWithCovarianceStamped,
}

# Every third point each way: the mean over a ninth of the points is the same to three digits.
_EVERY = 3


#: Figures of one flight by their names; lengths in millimetres.
Figures = dict[str, float]


def appraise(bag: Bag, world: World, progress: Callable[[], Any] = lambda: None) -> Figures:
    """Compare a bag with the world that it was recorded in.

    Parameters
    ----------
    bag : Bag
    world : World
        With the flight's start as it was flown.
    progress : callable
        Called after each cloud.

    Returns
    -------
    dict of str to float
        images, clouds, tagged_clouds: what the bag holds; tagged are those that have both cloud
        and pose. images_lost: published, and not in the bag. clouds_lost: images without a cloud;
        tagged_clouds_lost: clouds without the same in ``map`` and a pose.
        latency_*: from the middle of the exposure to the tagged cloud's arrival at the recorder.
        camera_mae_*: mean distance of the clouds' points to the true skin in the camera's frame,
        over all clouds and of the worst. map_mae_*: the same in ``map``, with the pose's errors.
    """
    stamps: dict[str, set[int]] = {topic: set() for topic in TYPES}
    image_numbers = []
    errors: dict[str, list[float]] = {'/points': [math.nan], '/tagged/points': [math.nan]}
    latencies = [math.nan]
    for message in bag.messages(TYPES):
        content = _content(message)
        stamp_ns = stamp_to_ns(content.header.stamp)
        stamps[message.topic].add(stamp_ns)
        if message.topic == '/camera/image_raw':
            image_numbers.append(message.sequence)
        if message.topic in errors:
            tagged_one = message.topic == '/tagged/points'
            surface = world.surface if tagged_one else world.seen_surface(stamp_ns)
            points = cloud_from_message(content).points[::_EVERY, ::_EVERY]
            errors[message.topic].append(mean_absolute(surface.distance(points)))
            progress()
            if tagged_one:
                latencies.append((message.log_time_ns - stamp_ns) / 1e6)
    images, clouds = stamps['/camera/image_raw'], stamps['/points']
    tagged = stamps['/tagged/points'] & stamps['/tagged/pose']
    return {
        'images': len(images),
        # By the holes in their publisher's count.
        'images_lost': int(np.ptp(image_numbers)) + 1 - len(image_numbers),
        'clouds': len(clouds),
        'clouds_lost': len(images - clouds),
        'tagged_clouds': len(tagged),
        'tagged_clouds_lost': len(clouds - tagged),
        'latency_median_ms': float(np.nanmedian(latencies)),
        'latency_maximum_ms': float(np.nanmax(latencies)),
        'camera_mae_mm': float(np.nanmean(errors['/points'])),
        'camera_mae_worst_mm': float(np.nanmax(errors['/points'])),
        'map_mae_mm': float(np.nanmean(errors['/tagged/points'])),
        'map_mae_worst_mm': float(np.nanmax(errors['/tagged/points'])),
    }


def clouds_of(bag: Bag) -> Iterator[tuple[int, Cloud]]:
    """Stamps (ns) and clouds in the camera's frame, in order."""
    for message in bag.messages(['/points']):
        content = _content(message)
        yield stamp_to_ns(content.header.stamp), cloud_from_message(content)


def mean_absolute(error: NDArray[np.float64]) -> float:
    """Mean absolute distance in millimetres; NaN of nothing."""
    measured = np.abs(error[np.isfinite(error)])
    return float(measured.mean()) * 1e3 if measured.size else float('nan')


def _content(message: Message) -> Any:
    return deserialize_message(message.data, TYPES[message.topic])


def appraise_skin(bag: Bag, joined: Joining, world: World) -> tuple[Figures, dict[int, Pose]]:
    """Compare the skin that a bag's clouds make by the survey's poses with the true one.

    Parameters
    ----------
    bag : Bag
    joined : Joining
        Its clouds.
    world : World
        In which it was recorded.

    Returns
    -------
    dict of str to float
        skin_mae_*: mean distance of the clouds' points to the true skin, which each part is put
        onto as one, over all clouds and of the worst. skin_parts: in how many parts it is, that
        share nothing.
    dict of int to Pose
        The moves that put each part onto the true skin, by the stamps of its clouds.
    """
    parts: dict[int, list[tuple[int, NDArray, NDArray]]] = {}
    groups = joined.graph.groups()
    clouds = {stamp: cloud for stamp, cloud in clouds_of(bag) if stamp in joined.numbers}
    for stamp, cloud in clouds.items():
        number = joined.numbers[stamp]
        # Some hundred points a cloud.
        few = cloud.points[::30, ::30].astype(float)
        few = few[np.isfinite(few).all(axis=-1)]
        found, true = joined.graph.poses[number].apply(few), world.camera_pose(stamp).apply(few)
        parts.setdefault(groups[number], []).append((stamp, found, true))
    moves: dict[int, Pose] = {}
    for part in parts.values():
        found, true = (np.concatenate([each[i] for each in part]) for i in (1, 2))
        middle, there = found.mean(axis=0), true.mean(axis=0)
        turn, _ = Rotation.align_vectors(true - there, found - middle)
        move = Pose(turn, there - turn.apply(middle))
        moves |= {stamp: move for stamp, *_ in part}
    errors = []
    for stamp, cloud in clouds.items():
        placed = cloud.transformed(moves[stamp] @ joined.graph.poses[joined.numbers[stamp]])
        errors.append(mean_absolute(world.surface.distance(placed.points[::_EVERY, ::_EVERY])))
    figures = {
        'skin_mae_mm': float(np.mean(errors)),
        'skin_mae_worst_mm': max(errors),
        'skin_parts': len(parts),
    }
    return figures, moves


def appraise_dents(
    bag: Bag,
    report: InspectionReport,
    world: World,
    camera: Lens,
    moves: Mapping[int, Pose],
) -> Figures:
    """Compare a report on a bag with the world that it was recorded in.

    Parameters
    ----------
    bag : Bag
    report : InspectionReport
    world : World
    camera : Lens
    moves : mapping of int to Pose
        Of `appraise_skin`.

    Returns
    -------
    dict of str to float
        dents: true ones that lie wholly inside some cloud; dents_missed: those that no cloud
        shows. sightings, sightings_missed: how often a true dent lies wholly inside a cloud, and
        is not found in it. dents_false: listed, and not there. depth_error_mm, length_error_mm,
        width_error_mm: largest of the combined measurements of dents that were seen whole.
        clouds_not_inspected. others: reported as something else than a dent.
    """
    truth = [true for true in true_dents(world.surface) if true.depth > 0]
    stamps = {frame.number: frame.stamp_ns or 0 for frame in report.frames}
    clouds = dict(clouds_of(bag))
    expected = {
        (index, number)
        for number, stamp in stamps.items()
        if stamp in clouds
        for index, true in enumerate(truth)
        if _lies_in(true, clouds[stamp], world.camera_pose(stamp).inverse(), camera)
    }
    found: set[tuple[int, int]] = set()
    false = 0
    errors = []
    for entry in report.entries:
        dent, is_dent = entry.dent, entry.dent.kind == 'dent'
        # A dent that two parts of the flight share lies in the list where one of them has it.
        places = [(entry.best, dent.position)]
        places += [(b.frame, a.dent.position) for a in entry.sightings for b in entry.sightings]
        at = (moves.get(stamps[number], IDENTITY).apply(place) for number, place in places)
        indices = (true_index(each, truth) for each in at)
        index = next((each for each in indices if each is not None), None)
        if index is None:
            false += is_dent
            continue
        if dent.depth.value > 0:
            # A crease is listed as one, and what is in doubt as something else.
            found |= {(index, sighting.frame) for sighting in entry.sightings}
        if is_dent and not dent.is_cut:
            measured = dent.depth.value, dent.length.value, dent.width.value
            true = truth[index]
            errors.append(np.subtract(measured, (true.depth, true.length, true.width)))
    whole = {index for index, _ in expected}
    worst = np.abs(errors).max(axis=0) * 1e3 if errors else np.full(3, np.nan)
    return {
        'dents': len(whole),
        'dents_missed': len(whole - {index for index, _ in found}),
        'sightings': len(expected),
        'sightings_missed': len(expected - found),
        'dents_false': false,
        'depth_error_mm': float(worst[0]),
        'length_error_mm': float(worst[1]),
        'width_error_mm': float(worst[2]),
        'clouds_not_inspected': len(report.refused),
        'others': len(report.others),
    }


def _lies_in(true: TrueDent, cloud: Cloud, seen_from: Pose, camera: Lens) -> bool:
    """Whether a dent lies wholly in the measured area, its small holes closed."""
    mask = cv2.morphologyEx(
        cloud.valid.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)
    )
    points = seen_from.apply(np.concatenate([true.border, true.position[None]]))
    if not (points[:, 2] > 0).all():
        return False
    stride = round(camera.width / mask.shape[1])
    column, row = np.round(camera.project(points) / stride).astype(int).T
    rows, columns = mask.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return bool(inside.all() and mask[row, column].all())
