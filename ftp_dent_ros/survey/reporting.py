"""A bag's report on clouds that were joined to one skin first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ftp_dent_ros.inspection.dent import Inspection
from ftp_dent_ros.inspection.reporting.bag import survey_bag
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.rules import Rules
from ftp_dent_ros.inspection.reporting.survey import Inspect
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.tracking.pose_errors import position_covariance
from ftp_dent_ros.recording.clouds import BagCloud
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.survey.evidence import skin_of
from ftp_dent_ros.survey.fused_skin import FusedSkin
from ftp_dent_ros.survey.joined import Joined, join_bags
from ftp_dent_ros.survey.result import SurveyedDent


def report_on_skin(
    bag: Bag,
    inspect: Inspect,
    rig: tuple[str, str] = ('', ''),
    camera: Lens | None = None,
    rules: Rules | None = None,
    settings: Settings | None = None,
    progress: Callable[[], Any] = lambda: None,
) -> tuple[Report, Joined]:
    """Join a bag's clouds, inspect each with what all tell of its place, and show the whole skin.

    Parameters
    ----------
    bag : Bag
    inspect : callable
        `ftp_dent_ros.inspection.measuring.inspection.inspect`.
    rig, camera, rules, settings
        As `ftp_dent_ros.inspection.reporting.bag.survey_bag` has them.
    progress : callable
        Called after each cloud, three times for each.

    Raises
    ------
    BagError
        It has no clouds in the camera's frame, or is damaged.
    CloudError
        No cloud in it could be used.
    """
    joined = join_bags([bag], progress)
    skin = FusedSkin([bag], joined, progress)

    def told(item: BagCloud, found: Inspection) -> Inspection:
        skin.shown(item, found)
        return skin.told(item, found)

    report = survey_bag(bag, inspect, rig, camera, rules, settings, progress, skin.prepared, told)
    report = replace(_in_the_map(report, joined), frame_id=joined.frame_id)
    dents = [
        SurveyedDent(each.number, each.dent, each.position_covariance, len(each.sightings))
        for each in report.entries
    ]
    links, left_out = joined.joining.graph.links, joined.joining.graph.left_out
    facts = [
        ('Joined by', f'{len(links) - len(left_out)} pairs of clouds, {len(left_out)} left out')
    ]
    return replace(report, skin=skin_of(skin.mosaic, dents, facts, joined.remarks)), joined


def _in_the_map(report: Report, joined: Joined) -> Report:
    """Places with what all of them have in common: the error of the autopilot's poses."""
    frames = [
        frame
        if frame.stamp_ns not in joined.numbers
        else replace(frame, covariance=joined.covariances[joined.numbers[frame.stamp_ns]])
        for frame in report.frames
    ]
    by_number = {frame.number: frame for frame in frames}
    entries = [
        replace(
            each,
            position_covariance=position_covariance(
                each.dent.position, by_number[each.best].pose, by_number[each.best].covariance
            ),
        )
        for each in report.entries
    ]
    return replace(report, frames=tuple(frames), entries=tuple(entries))
