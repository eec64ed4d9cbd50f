"""Bags to one survey: all poses, then what clouds tell together, then dents and the picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ftp_dent_ros import __version__
from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.inspection.dent import Inspection
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.tracking.dent_list import DentList
from ftp_dent_ros.inspection.tracking.glass import sentence
from ftp_dent_ros.inspection.tracking.pose_errors import position_covariance
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.survey.fused_skin import FusedSkin
from ftp_dent_ros.survey.joined import join_bags
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult
from ftp_dent_ros.survey.skin_map.mosaic import Mosaic


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
        Called after each cloud, three times for each.
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
    joined = join_bags(bags, progress, remark)
    joining, poses = joined.joining, joined.poses
    skin = FusedSkin(bags, joined, progress)
    dents = DentList()
    for raw in skin.clouds():
        item = skin.prepared(raw)
        found = _inspected(item.cloud, settings)
        skin.shown(item, found)
        if found is not None and item.pose is not None:
            found = skin.told(item, found)
            seen = [each.transformed(item.pose) for each in (*found.dents, *found.others)]
            number = joined.numbers[item.stamp_ns]
            dents.add(number, seen, item.pose, item.covariance, stamp_ns=item.stamp_ns)
        progress()
    covariances, mosaic = joined.covariances, skin.mosaic
    surveyed = tuple(
        SurveyedDent(
            each.number,
            replace(each.dent, reason=each.reason),
            position_covariance(each.dent.position, poses[each.best], covariances[each.best]),
            len(each.sightings),
            skin.relief(each.dent),
        )
        for each in dents.entries
    )
    result = SurveyResult(
        name=name or bags[0].path.stem,
        sources=tuple(str(bag.path) for bag in bags),
        taken_ns=min(joining.stamps_ns),
        frame_id=joined.frame_id,
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
    remarks = joined.remarks
    if dents.glass:
        remarks = (*remarks, sentence(dents.glass))
    return Surveyed(result, mosaic, remarks, pairs, len(joining.graph.left_out))


def _inspected(cloud: Cloud, settings: Settings) -> Inspection | None:
    try:
        return inspect(cloud, settings)
    except FtpDentError:
        return None
