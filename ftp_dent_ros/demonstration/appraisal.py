"""What a flight measured against the truth of its scene: clouds, skin and dents."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.inspection.report import InspectionReport
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.recording.topic import Message
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.dent_messages import KINDS, dents_from_message
from ftp_dent_ros.ros.messages import cloud_from_message, stamp_to_ns
from ftp_dent_ros.simulation.truth import TrueDent, true_dents, true_index
from ftp_dent_ros.simulation.world import World
from ftp_dent_ros.survey.surveying import JoinedClouds

TYPES = {
    '/camera/image_raw': Image,
    '/points': PointCloud2,
    '/tagged/points': PointCloud2,
    '/tagged/pose': PoseWithCovarianceStamped,
    '/mavlink/pose': PoseStamped,
}

# Every third point each way: the mean over a ninth of the points is the same to three digits.
_EVERY = 3

_MM = 1e3


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
        images, clouds, tagged_clouds, poses: what the bag holds; tagged are those that have both
        cloud and pose. images_lost, poses_lost: published, and not in the bag. clouds_lost: images
        without a cloud; tagged_clouds_lost: clouds without the same in ``map`` and a pose.
        latency_*: from the middle of the exposure to the tagged cloud's arrival at the recorder.
        camera_mae_*: mean distance of the clouds' points to the true skin in the camera's frame,
        over all clouds and of the worst. map_mae_*: the same in ``map``, with the pose's errors.
    """
    stamps: dict[str, set[int]] = {topic: set() for topic in TYPES}
    counts: dict[str, set[int]] = {topic: set() for topic in TYPES}
    latencies, camera_errors, map_errors = [math.nan], [math.nan], [math.nan]
    for message in bag.messages(TYPES):
        content = deserialize_message(message.data, TYPES[message.topic])
        stamp_ns = stamp_to_ns(content.header.stamp)
        stamps[message.topic].add(stamp_ns)
        counts[message.topic].add(message.sequence)
        if message.topic == '/points':
            error = camera_error(world, cloud_from_message(content), stamp_ns, _EVERY)
            camera_errors.append(mean_absolute(error))
            progress()
        elif message.topic == '/tagged/points':
            latencies.append((message.log_time_ns - stamp_ns) / 1e6)
            error = map_error(world, cloud_from_message(content), _EVERY)
            map_errors.append(mean_absolute(error))
            progress()
    images, clouds = stamps['/camera/image_raw'], stamps['/points']
    tagged = stamps['/tagged/points'] & stamps['/tagged/pose']
    return {
        'images': len(images),
        'images_lost': _holes(counts['/camera/image_raw']),
        'clouds': len(clouds),
        'clouds_lost': len(images - clouds),
        'tagged_clouds': len(tagged),
        'tagged_clouds_lost': len(clouds - tagged),
        'poses': len(stamps['/mavlink/pose']),
        'poses_lost': _holes(counts['/mavlink/pose']),
        'latency_median_ms': float(np.nanmedian(latencies)),
        'latency_maximum_ms': float(np.nanmax(latencies)),
        'camera_mae_mm': float(np.nanmean(camera_errors)),
        'camera_mae_worst_mm': float(np.nanmax(camera_errors)),
        'map_mae_mm': float(np.nanmean(map_errors)),
        'map_mae_worst_mm': float(np.nanmax(map_errors)),
    }


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
    return float(measured.mean()) * _MM if measured.size else float('nan')


def _content(message: Message) -> Any:
    return deserialize_message(message.data, TYPES[message.topic])


def _holes(counts: set[int]) -> int:
    """How many of a publisher's messages are missing between the first and the last."""
    return max(counts) - min(counts) + 1 - len(counts) if counts else 0


@dataclass(frozen=True, eq=False)
class Onto:
    """The moves that put each part of a survey onto the true skin, by the stamps of its clouds."""

    moves: Mapping[int, Pose]
    places: NDArray[np.float64]
    offsets: NDArray[np.float64]

    def move(self, stamp_ns: int | None) -> Pose:
        """Of the part that a cloud belongs to; none where it is in no part."""
        none = Pose(Rotation.identity(), np.zeros(3))
        return none if stamp_ns is None else self.moves.get(stamp_ns, none)


def onto_truth(bag: Bag, joined: JoinedClouds, world: World) -> Onto:
    """Put each part of a survey as one onto its true place."""
    parts: dict[int, list[tuple[int, NDArray, NDArray]]] = {}
    groups = joined.joining.graph.groups()
    for stamp, cloud in clouds_of(bag, '/points'):
        number = joined.numbers.get(stamp)
        if number is not None:
            # Some hundred points a cloud.
            few = cloud.points[::30, ::30].astype(float)
            few = few[np.isfinite(few).all(axis=-1)]
            found, true = joined.poses[number].apply(few), world.camera_pose(stamp).apply(few)
            parts.setdefault(groups[number], []).append((stamp, found, true))
    moves: dict[int, Pose] = {}
    places, offsets = [], []
    for part in parts.values():
        found, true = (np.concatenate([each[i] for each in part]) for i in (1, 2))
        middle, there = found.mean(axis=0), true.mean(axis=0)
        turn, _ = Rotation.align_vectors(true - there, found - middle)
        move = Pose(turn, there - turn.apply(middle))
        moves |= {stamp: move for stamp, *_ in part}
        places.append(move.apply(found) - true)
        offsets.append(found - true)
    return Onto(moves, np.concatenate(places), np.concatenate(offsets))


def appraise_skin(bag: Bag, joined: JoinedClouds, world: World, onto: Onto) -> Figures:
    """Compare the skin that a bag's clouds make by the survey's poses with the true one.

    Parameters
    ----------
    bag : Bag
    joined : JoinedClouds
        Its clouds.
    world : World
        In which it was recorded.
    onto : Onto
        From `onto_truth`.

    Returns
    -------
    dict of str to float
        skin_mae_*: mean distance of the clouds' points to the true skin, which each part is put
        onto as one, over all clouds and of the worst. skin_place_mm: root mean square of how far
        points lie from their true places then, mostly along the skin. skin_off_mm: how far the
        whole is off in the map, by the autopilot, root mean square. skin_parts: in how many parts
        it is, that share nothing. skin_pairs_left_out: pairs of clouds that contradict the others.
    """
    errors = []
    for stamp, cloud in clouds_of(bag, '/points'):
        number = joined.numbers.get(stamp)
        if number is not None:
            placed = cloud.transformed(onto.move(stamp) @ joined.poses[number])
            errors.append(mean_absolute(map_error(world, placed, _EVERY)))
    return {
        'skin_mae_mm': float(np.mean(errors)),
        'skin_mae_worst_mm': max(errors),
        'skin_place_mm': _rms(onto.places) * _MM,
        'skin_off_mm': _rms(onto.offsets) * _MM,
        'skin_parts': len({id(move) for move in onto.moves.values()}),
        'skin_pairs_left_out': len(joined.joining.graph.left_out),
    }


def _rms(offsets: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.square(offsets).sum(axis=-1).mean()))


def false_in_list(listed: NDArray[Any], truth: Sequence[TrueDent]) -> int:
    """How many of the dents of a list are not there.

    A listed dent is true if it lies by a true one within what it states of its place, and has
    its sizes.

    Parameters
    ----------
    listed : ndarray
        Structured, shape (n,), as of `ftp_dent_ros.ros.dent_messages.dents_from_message`, metres.
    truth : sequence of TrueDent
        In the list's frame of reference.
    """
    if not len(listed) or not truth:
        return len(listed)
    places = np.stack([listed[axis] for axis in 'xyz'], axis=-1).astype(float)
    there = np.stack([each.position for each in truth])
    off = places[:, None] - there
    # Three standard uncertainties of three axes hold 97 in 100.
    reach = np.array([each.length / 2 for each in truth]) + 3.0 * np.array(
        listed['position_uncertainty'], float
    ).reshape(-1, 1)
    may_be = (np.linalg.norm(off, axis=-1) <= reach) & _sizes_agree(listed, truth)
    return int((~may_be.any(axis=1)).sum())


def _sizes_agree(listed: NDArray[Any], truth: Sequence[TrueDent]) -> NDArray[np.bool_]:
    """Whether listed dents have the sizes of true ones, (listed, true).

    A cut one is no deeper: its length and width are those of what its clouds show.
    """
    result = np.ones((len(listed), len(truth)), bool)
    is_cut = listed['is_cut'].astype(bool)[:, None]
    sizes = {
        'length': [max(each.length, each.width) for each in truth],
        'width': [min(each.length, each.width) for each in truth],
        'depth': [each.depth for each in truth],
    }
    for name, values in sizes.items():
        true = np.array(values)
        more = listed[name].astype(float)[:, None] - true
        sigma = np.nan_to_num(listed[f'{name}_uncertainty'].astype(float))[:, None]
        # What differs by more is another dent, however badly it was measured.
        allowed = 4.0 * sigma + 0.25 * true
        # What is not known of a size says nothing against it.
        differs = (more > allowed) | (~is_cut & (more < -allowed))
        result &= ~differs if name == 'depth' else ~differs | is_cut
    return result


def appraise_dents(
    bag: Bag,
    report: InspectionReport,
    world: World,
    camera: Lens,
    move: Callable[[int | None], Pose],
) -> Figures:
    """Compare a report on a bag with the world that it was recorded in.

    Parameters
    ----------
    bag : Bag
    report : InspectionReport
    world : World
    camera : Lens
    move : callable
        What puts the clouds that belong to the one of a stamp onto the true skin.

    Returns
    -------
    dict of str to float
        dents: true ones that lie wholly inside some cloud; dents_missed: those that no cloud
        shows. sightings, sightings_missed: how often a true dent lies wholly inside a cloud, and
        is not found in it. dents_false: listed, and not there. depth_error_mm, length_error_mm,
        width_error_mm: largest of the combined measurements of dents that were seen whole.
        dents_in_list, dents_false_in_list: what the node's own list held at the end, and what of
        it is no true dent. clouds_not_inspected. others: reported as something else than a dent.
    """
    truth = [true for true in true_dents(world.surface) if true.depth > 0]
    clouds = dict(clouds_of(bag, '/points'))
    expected: set[tuple[int, int]] = set()
    for frame in report.frames:
        stamp_ns = frame.stamp_ns
        if stamp_ns in clouds:
            seen_from = world.camera_pose(stamp_ns).inverse()
            inside = _inside(clouds[stamp_ns], camera)
            expected |= {
                (index, frame.number)
                for index, true in enumerate(truth)
                if _lies_in(true, inside, seen_from, camera)
            }
    stamps = {frame.number: frame.stamp_ns for frame in report.frames}
    found: set[tuple[int, int]] = set()
    false = 0
    errors = []
    for entry in report.entries:
        is_dent = entry.dent.kind == 'dent'
        # A dent that two parts of the flight share lies in the list where one of them has it.
        elsewhere = [
            move(stamps[part.frame]).apply(each.dent.position)
            for each in entry.sightings
            for part in entry.sightings
        ]
        place = move(stamps[entry.best]).apply(entry.dent.position)
        at = (true_index(each, truth) for each in (place, *elsewhere))
        index = next((each for each in at if each is not None), None)
        if index is None:
            false += is_dent
            continue
        if entry.dent.depth.value > 0:
            # A crease is listed as one, and what is in doubt as something else.
            found |= {(index, sighting.frame) for sighting in entry.sightings}
        if is_dent and not entry.dent.is_cut:
            errors.append(_errors(entry, truth[index]))
    whole = {index for index, _ in expected}
    listed_by_node = _last_list(bag)
    worst = np.abs(errors).max(axis=0) * _MM if errors else np.full(3, np.nan)
    return {
        'dents': len(whole),
        'dents_missed': len(whole - {index for index, _ in found}),
        'sightings': len(expected),
        'sightings_missed': len(expected - found),
        'dents_false': false,
        'depth_error_mm': float(worst[0]),
        'length_error_mm': float(worst[1]),
        'width_error_mm': float(worst[2]),
        'dents_in_list': len(listed_by_node),
        'dents_false_in_list': false_in_list(listed_by_node, truth),
        'clouds_not_inspected': len(report.refused),
        'others': len(report.others),
    }


def _inside(cloud: Cloud, camera: Lens) -> tuple[np.ndarray, int]:
    """Mask of the measured area with its small holes closed, and the cloud's stride."""
    stride = round(camera.width / cloud.valid.shape[1])
    closed = cv2.morphologyEx(
        cloud.valid.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)
    )
    return closed > 0, stride


def _lies_in(
    true: TrueDent, inside: tuple[np.ndarray, int], seen_from: Pose, camera: Lens
) -> bool:
    mask, stride = inside
    points = seen_from.apply(np.concatenate([true.border, true.position[None]]))
    if not (points[:, 2] > 0).all():
        return False
    column, row = np.round(camera.project(points) / stride).astype(int).T
    rows, columns = mask.shape
    if not ((row >= 0) & (row < rows) & (column >= 0) & (column < columns)).all():
        return False
    return bool(mask[row, column].all())


def _errors(entry: ListedDent, true: TrueDent) -> tuple[float, float, float]:
    dent = entry.dent
    return (
        dent.depth.value - true.depth,
        dent.length.value - max(true.length, true.width),
        dent.width.value - min(true.length, true.width),
    )


def _last_list(bag: Bag) -> NDArray[Any]:
    """Dents in the last list that the node published, as of `dents_from_message`; none before."""
    if not bag.metadata.message_counts.get('/dents/list', 0):
        return np.zeros(0)
    *_, last = bag.messages(['/dents/list'])
    dents = dents_from_message(deserialize_message(last.data, PointCloud2))
    return dents[dents['kind'] == KINDS.index('dent')]
