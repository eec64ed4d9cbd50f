"""The clouds of a bag, inspected."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.dent import Inspection
from ftp_dent_ros.inspection.observation import SAME, Observation, viewpoint_of
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.inspecting import Inspect, Inspected, Task
from ftp_dent_ros.inspection.reporting.rules import Rules
from ftp_dent_ros.inspection.reporting.survey import Survey
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.clouds import BagCloud, Skipped, bag_clouds, count_clouds
from ftp_dent_ros.recording.coverages import coverages_of
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig import Lens

Placed = Callable[[BagCloud], 'tuple[Pose, NDArray[np.float64]] | None']
Each = Callable[[Callable[[Task], Inspected], Iterable[Task]], Iterator[Inspected]]


def survey_bag(
    bag: Bag,
    inspect: Inspect,
    rig: tuple[str, str] = ('', ''),
    camera: Lens | None = None,
    rules: Rules | None = None,
    settings: Settings | None = None,
    progress: Callable[[], Any] = lambda: None,
    placed: Placed = lambda item: None,
    seen: Callable[[BagCloud, Inspection], Any] = lambda item, found: None,
    each: Each = map,
) -> Report:
    """Inspect every cloud of a bag: the tagged ones with their poses, else those of ``points``.

    Parameters
    ----------
    bag : Bag
    inspect : callable
        `ftp_dent_ros.inspection.measuring.inspection.inspect`.
    rig : (str, str)
        The calibration's name and id.
    camera : Lens, optional
        Of that rig, to draw the dents into the photographs.
    rules : Rules, optional
    settings : Settings, optional
    progress : callable
        Called after each cloud.
    placed : callable
        Gives the camera's pose at a cloud, and its covariance, where the bag's is not to be used.
    seen : callable
        Called with each cloud that was inspected, and its inspection.
    each : callable
        As `map`: where clouds are inspected, and how many of them at once.

    Returns
    -------
    Report
        It names the messages that could not be used.

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
    skipped: list[Skipped] = []
    read: deque[tuple[BagCloud, Observation]] = deque()

    def tasks() -> Iterator[Task]:
        for item in bag_clouds(bag, skipped.append):
            observation = _observation(item, placed(item))
            read.append((item, observation))
            yield survey.task(observation)

    for inspected in each(survey.inspect, tasks()):
        item, observation = read.popleft()
        found = survey.take(observation, inspected)
        if found is not None:
            seen(item, found)
        frame_id, in_camera = item.frame_id, in_camera and item.in_camera
        progress()
    report = survey.report(str(bag.path), frame_id, rig, camera if in_camera else None, rules)
    if not report.frames:
        reasons = [*survey.refused, *map(str, skipped)]
        reason = f' ({reasons[0]})' if reasons else ''
        raise CloudError(
            f'{bag.path}: no cloud in it could be inspected{reason}: check the clouds'
        )
    told = coverages_of(bag)
    frames = tuple(
        frame if frame.stamp_ns is None else replace(frame, coverage=told.get(frame.stamp_ns))
        for frame in report.frames
    )
    return replace(report, frames=frames, skipped=tuple(map(str, skipped)))


def _observation(item: BagCloud, placed: tuple[Pose, NDArray[np.float64]] | None) -> Observation:
    if placed is not None:
        pose, covariance = placed
        item = replace(item, pose=pose, vehicle=pose, covariance=covariance)
    return Observation(
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
