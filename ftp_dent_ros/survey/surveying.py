"""Bags to one survey: first all poses, then the dents and the picture of the skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros import __version__
from ftp_dent_ros.errors import BagError, CloudError, FtpDentError
from ftp_dent_ros.inspection.dent import Inspection
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.tracking.dent_list import DentList
from ftp_dent_ros.inspection.tracking.pose_errors import position_covariance
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.clouds import BagCloud, bag_clouds
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.survey.joining import Joining
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult
from ftp_dent_ros.survey.unrolling import Unrolled

# A scale that light, which stays with the camera, gives to what is seen on the way: a share.
_SCALE = 7e-4
# Of a pose that says nothing of its accuracy: metres, radians; more than the dent list takes.
_UNKNOWN = np.diag([0.03**2] * 3 + [0.015**2] * 3)
# Frame of a survey that no autopilot has placed.
_OWN_FRAME = 'survey'


@dataclass(frozen=True, eq=False)
class Surveyed:
    """A survey with its picture.

    Attributes
    ----------
    result : SurveyResult
    mosaic : Mosaic
    remarks : tuple of str
        What could not be used, and why; what was assumed.
    pairs, left_out : int
        Relative poses, and how many of them contradict the others.
    """

    result: SurveyResult
    mosaic: Mosaic
    remarks: tuple[str, ...]
    pairs: int
    left_out: int


def survey_bags(
    bags: Sequence[Bag],
    name: str = '',
    settings: Settings | None = None,
    rig_id: str = '',
    progress: Callable[[], Any] = lambda: None,
    remark: Callable[[str], Any] = lambda text: None,
) -> Surveyed:
    """Make one skin of the clouds of all bags, which show one aircraft.

    Parameters
    ----------
    bags : sequence of Bag
    name : str
    settings : Settings, optional
        The smallest dents that are looked for.
    rig_id : str
        Id of the calibration.
    progress : callable
        Called after each cloud, twice for each.
    remark : callable
        Called with each remark as it comes up.

    Raises
    ------
    BagError
        A bag has no clouds in the camera's frame, or poses in another map than the others.
    CloudError
        No cloud can be used.
    """
    settings = settings or Settings()
    joining, frame_id, remarks = _joined(bags, progress, remark)
    poses = joining.graph.poses
    skin, low, high = _skin(joining, bags)
    mosaic = Mosaic(skin, low, high)
    middle = len(poses) // 2
    near = joining.graph.covariances(anchor=middle)
    covariances = joining.graph.covariances()
    for spread in (near, covariances):
        _widen(spread, poses, middle)
    dents = DentList()
    numbers = {stamp: number for number, stamp in enumerate(joining.stamps_ns)}
    for bag in bags:
        for item in bag_clouds(bag):
            number = numbers.pop(item.stamp_ns, None)
            if number is None:
                continue
            found = _inspected(item, settings)
            mosaic.add(number, item.cloud, poses[number], item.skin, found)
            if found is not None:
                seen = [each.transformed(poses[number]) for each in (*found.dents, *found.others)]
                dents.add(number, seen, poses[number], near[number], stamp_ns=item.stamp_ns)
            progress()
    surveyed = tuple(
        SurveyedDent(
            each.number,
            each.dent,
            position_covariance(each.dent.position, poses[each.best], covariances[each.best]),
            len(each.sightings),
        )
        for each in dents.entries
    )
    result = SurveyResult(
        name=name or bags[0].path.stem,
        sources=tuple(str(bag.path) for bag in bags),
        taken_ns=min(joining.stamps_ns),
        frame_id=frame_id,
        dents=surveyed,
        stamps_ns=tuple(joining.stamps_ns),
        poses=tuple(poses),
        covariances=covariances,
        coverage=mosaic.coverage(),
        settings=settings,
        rig_id=rig_id,
        software=__version__,
    )
    pairs = len(joining.graph.links)
    return Surveyed(result, mosaic, tuple(remarks), pairs, len(joining.graph.left_out))


def _joined(
    bags: Sequence[Bag], progress: Callable[[], Any], remark: Callable[[str], Any]
) -> tuple[Joining, str, list[str]]:
    """All clouds of all bags, joined; the frame of their poses; and what there is to say."""
    remarks: list[str] = []

    def say(text: str) -> None:
        remarks.append(text)
        remark(text)

    joining = Joining(say)
    frame_id, known = '', set[int]()
    unplaced = without_covariance = 0
    for flight, bag in enumerate(bags):
        for item in bag_clouds(bag, lambda skipped: say(str(skipped))):
            if not item.in_camera:
                raise BagError(
                    f'{bag.path}: has its clouds in {item.frame_id} alone: record /points too'
                )
            if item.stamp_ns in known:
                continue
            known.add(item.stamp_ns)
            if item.pose is not None:
                if frame_id not in ('', item.frame_id):
                    raise BagError(
                        f'{bag.path}: its poses are in {item.frame_id!r}, those before in '
                        f'{frame_id!r}: survey them one by one'
                    )
                frame_id = item.frame_id
            covariance = item.covariance
            if item.pose is not None and (covariance is None or not np.any(covariance)):
                covariance, without_covariance = _UNKNOWN, without_covariance + 1
            unplaced += item.pose is None
            try:
                joining.add(item.stamp_ns, item.cloud, item.skin, item.pose, covariance, flight)
            except CloudError as reason:
                say(f'cloud at {item.stamp_ns / 1e9:.3f} s: {reason}')
            progress()
    if not joining.stamps_ns:
        raise CloudError(f'{bags[0].path}: no cloud in it can be used: check the clouds')
    joining.finish()
    clouds = len(joining.stamps_ns)
    if unplaced:
        say(
            f'{unplaced} of {clouds} clouds have no pose: they are placed by what they share with '
            'the others alone' + ('' if frame_id else ', in a frame of their own')
        )
    if without_covariance:
        say(f'{without_covariance} poses do not state how good they are: 30 mm is taken')
    if joining.without_skin:
        say(
            f'{joining.without_skin} of {clouds} clouds have no image of the skin: along the skin '
            'they lie as the autopilot says; record /skin too'
        )
    _tell_groups(joining, say)
    return joining, frame_id or _OWN_FRAME, remarks


def _tell_groups(joining: Joining, say: Callable[[str], Any]) -> None:
    groups: dict[int, list[int]] = {}
    for number, group in enumerate(joining.graph.groups()):
        groups.setdefault(group, []).append(number)
    if len(groups) > 1:
        sizes = ', '.join(str(len(each)) for each in sorted(groups.values(), key=len)[::-1][:8])
        say(
            f'the clouds are not one skin but {len(groups)} parts ({sizes} clouds): between these '
            'nothing that they share tells how they lie, only the autopilot'
        )


def _skin(
    joining: Joining, bags: Sequence[Bag]
) -> tuple[Unrolled, NDArray[np.float64], NDArray[np.float64]]:
    """The unrolled skin, and its extent."""
    points = np.concatenate(
        [
            pose.apply(each)
            for pose, each in zip(joining.graph.poses, joining.outlines, strict=True)
        ]
    )
    normals = np.stack(
        [
            pose.rotation.apply(each)
            for pose, each in zip(joining.graph.poses, joining.normals, strict=True)
        ]
    )
    repeated = np.repeat(normals, [len(each) for each in joining.outlines], axis=0)
    skin = Unrolled.through(points, repeated)
    place = skin.place(points)[:, :2]
    room = 0.05
    return skin, place.min(axis=0) - room, place.max(axis=0) + room


def _inspected(item: BagCloud, settings: Settings) -> Inspection | None:
    try:
        return inspect(item.cloud, settings)
    except FtpDentError:
        return None


def _widen(covariances: NDArray[np.float64], poses: Sequence[Pose], middle: int) -> None:
    """Add what the scale may be off by, from the middle on."""
    for covariance, pose in zip(covariances, poses, strict=True):
        off = _SCALE * (pose.translation - poses[middle].translation)
        covariance[:3, :3] += np.outer(off, off)
