"""The dents that a simulated flight found, held against those that were there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.demonstration.appraisal import clouds_of
from ftp_dent_ros.demonstration.list_check import check_list
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.inspection.report import Report
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.ros.dent_messages import KINDS, dents_from_message
from ftp_dent_ros.simulation.truth import TrueDent, is_at_lap, true_dents
from ftp_dent_ros.simulation.truth_matching import true_index
from ftp_dent_ros.simulation.world import World

_MM = 1e3
# How far a step may be told beside the lap's edge, metres: a row of rivets' step.
_SEAM = 0.025


@dataclass(frozen=True)
class DentAppraisal:
    """Figures of the dents of one flight.

    Attributes
    ----------
    dents : int
        True dents that lie wholly inside some cloud.
    dents_missed : int
        Those of them that no cloud shows.
    sightings, sightings_missed : int
        How often a true dent lies wholly inside a cloud, and is not found in it.
    dents_false, dents_twice : int
        Listed, and not there; and one that is listed already, whole or a part of it.
    depth_error_mm, length_error_mm, width_error_mm : float
        Largest absolute error of the combined measurements of dents that were seen whole.
    dents_in_list, dents_false_in_list, dents_twice_in_list : int
        What the node's own list held at the end; what of it is no true dent by its place and
        sizes; and what is one that it has already: where photographs lie too far apart, the
        autopilot's poses alone do not tell that.
    clouds_not_inspected : int
    others, others_false : int
        Reported as something else than a dent, and of these where there is neither a dent nor,
        for a step, a lap.
    """

    dents: int
    dents_missed: int
    sightings: int
    sightings_missed: int
    dents_false: int
    dents_twice: int
    depth_error_mm: float
    length_error_mm: float
    width_error_mm: float
    dents_in_list: int
    dents_false_in_list: int
    dents_twice_in_list: int
    clouds_not_inspected: int
    others: int
    others_false: int


def appraise_dents(
    bag: Bag,
    report: Report,
    world: World,
    camera: Lens,
    move: Callable[[int | None], Pose],
) -> DentAppraisal:
    """Compare a report on a bag with the world that it was recorded in.

    Parameters
    ----------
    bag : Bag
    report : Report
    world : World
    camera : Lens
    move : callable
        What puts the clouds that belong to the one of a stamp onto the true skin.
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
    listed: list[int] = []
    errors = []
    others_false = 0
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
            is_step = entry.dent.kind == 'step' and is_at_lap(world.surface, place, _SEAM)
            false += is_dent
            others_false += not (is_dent or is_step)
            continue
        if entry.dent.depth.value > 0:
            # A crease is listed as one, and what is in doubt as something else.
            found |= {(index, sighting.frame) for sighting in entry.sightings}
        if is_dent:
            listed.append(index)
        if is_dent and not entry.dent.is_cut:
            errors.append(_errors(entry, truth[index]))
    whole = {index for index, _ in expected}
    listed_by_node = _last_list(bag)
    false_in_list, twice_in_list = check_list(listed_by_node, truth)
    worst = np.abs(errors).max(axis=0) * _MM if errors else np.full(3, np.nan)
    return DentAppraisal(
        dents=len(whole),
        dents_missed=len(whole - {index for index, _ in found}),
        sightings=len(expected),
        sightings_missed=len(expected - found),
        dents_false=false,
        dents_twice=len(listed) - len(set(listed)),
        depth_error_mm=float(worst[0]),
        length_error_mm=float(worst[1]),
        width_error_mm=float(worst[2]),
        dents_in_list=len(listed_by_node),
        dents_false_in_list=false_in_list,
        dents_twice_in_list=twice_in_list,
        clouds_not_inspected=len(report.refused),
        others=len(report.others),
        others_false=others_false,
    )


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
