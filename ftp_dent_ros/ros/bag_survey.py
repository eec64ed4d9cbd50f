"""The clouds of a bag, inspected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.captured import SAME, Captured, viewpoint_of
from ftp_dent_ros.inspection.report import Report
from ftp_dent_ros.inspection.rules import Rules
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.survey import Inspect, Survey
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig import Lens
from ftp_dent_ros.ros.bag_clouds import BagCloud, bag_clouds, count_clouds


def survey_bag(
    bag: Bag,
    inspect: Inspect,
    rig: tuple[str, str] = ('', ''),
    camera: Lens | None = None,
    rules: Rules | None = None,
    settings: Settings | None = None,
    progress: Callable[[], Any] = lambda: None,
) -> Report:
    """Inspect every cloud of a bag: the tagged ones with their poses, else those of ``points``.

    Parameters
    ----------
    bag : Bag
    inspect : callable
        `ftp_dent_ros.inspection.inspection.inspect`.
    rig : (str, str)
        The calibration's name and id.
    camera : Lens, optional
        Of that rig, to draw the dents into the photographs.
    rules : Rules, optional
    settings : Settings, optional
    progress : callable
        Called after each cloud.

    Raises
    ------
    BagError
        It has no clouds, or is damaged.
    CloudError
        No cloud in it could be inspected.
    """
    count, tagged = count_clouds(bag)
    survey = Survey(inspect, count, repeat=tagged, placed=tagged, settings=settings)
    frame_id, in_camera = '', True
    for item in bag_clouds(bag):
        survey.add(_captured(item))
        frame_id, in_camera = item.frame_id, in_camera and item.in_camera
        progress()
    report = survey.report(str(bag.path), frame_id, rig, camera if in_camera else None, rules)
    if not report.frames:
        reason = f' ({survey.refused[0]})' if survey.refused else ''
        raise CloudError(
            f'{bag.path}: no cloud in it could be inspected{reason}: check the clouds'
        )
    return report


def _captured(item: BagCloud) -> Captured:
    return Captured(
        name=f'{item.stamp_ns / 1e9:.3f} s',
        cloud=item.cloud,
        stamp_ns=item.stamp_ns,
        viewpoint=(0.0, 0.0, 0.0) if item.in_camera else viewpoint_of(item.cloud),
        pose=SAME if item.pose is None else item.pose,
        vehicle=item.vehicle,
        covariance=item.covariance,
        # The bridge gives the pose at exactly the cloud's stamp.
        pose_age=None if item.vehicle is None else 0.0,
        photograph=item.photograph,
    )
