"""Bags to one survey: first all poses, then the dents and the picture of the skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ftp_dent_ros import __version__
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.inspection.dent import Inspection
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.tracking.dent_list import DentList
from ftp_dent_ros.inspection.tracking.pose_errors import position_covariance
from ftp_dent_ros.recording.clouds import BagCloud, bag_clouds
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.survey.joined import join_bags
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.result import SurveyedDent, SurveyResult


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
    joined = join_bags(bags, progress, remark)
    joining, poses = joined.joining, joined.poses
    mosaic = joined.mosaic()
    near, covariances = joined.covariances_among_them, joined.covariances
    dents = DentList()
    numbers = dict(joined.numbers)
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
    return Surveyed(result, mosaic, joined.remarks, pairs, len(joining.graph.left_out))


def _inspected(item: BagCloud, settings: Settings) -> Inspection | None:
    try:
        return inspect(item.cloud, settings)
    except FtpDentError:
        return None
