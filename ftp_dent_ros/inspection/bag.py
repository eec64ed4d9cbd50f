"""The clouds of a bag, inspected."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

from ftp_dent_ros.dents.dent import Inspection, SmallestDent
from ftp_dent_ros.dents.rules import Rules
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.inspection.inspecting import (
    CloudInspector,
    Inspect,
    Inspected,
    SeenCloud,
    Task,
    viewpoint_of,
)
from ftp_dent_ros.inspection.report import InspectionReport
from ftp_dent_ros.pose import IDENTITY
from ftp_dent_ros.recording.clouds import (
    BagCloud,
    bag_clouds,
    count_clouds,
    coverages_of,
)
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig.rig import Lens

Each = Callable[[Callable[[Task], Inspected], Iterable[Task]], Iterator[Inspected]]


def survey_bag(
    bag: Bag,
    inspect: Inspect,
    rig: tuple[str, str] = ('', ''),
    camera: Lens | None = None,
    rules: Rules | None = None,
    settings: SmallestDent | None = None,
    progress: Callable[[], Any] = lambda: None,
    prepared: Callable[[BagCloud], BagCloud] | None = None,
    completed: Callable[[BagCloud, Inspection], Inspection | None] = lambda item, found: found,
    each: Each = map,
) -> InspectionReport:
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
    settings : SmallestDent, optional
    progress : callable
        Called after each cloud.
    prepared : callable, optional
        Gives a cloud as it is to be inspected, with what others tell of its place: then clouds
        are no measurements by themselves, of whose repeatability anything could be said.
    completed : callable
        Gives the whole inspection of such a cloud, from its own.
    each : callable
        As `map`: where clouds are inspected, and how many of them at once.

    Returns
    -------
    InspectionReport
        It names the messages that could not be used.

    Raises
    ------
    BagError
        It has no clouds, or is damaged.
    CloudError
        No cloud in it could be inspected.
    """
    count, tagged = count_clouds(bag)
    repeat = tagged and prepared is None
    survey = CloudInspector(inspect, count, repeat=repeat, placed=tagged, settings=settings)
    frame_id, in_camera = '', True
    skipped: list[str] = []
    read: deque[tuple[BagCloud, SeenCloud]] = deque()

    def tasks() -> Iterator[Task]:
        for item in bag_clouds(bag, skipped.append):
            item = item if prepared is None else prepared(item)
            observation = _observation(item)
            read.append((item, observation))
            yield survey.task(observation)

    for inspected in each(survey.inspect, tasks()):
        item, observation = read.popleft()
        if inspected.found is not None:
            inspected = replace(inspected, found=completed(item, inspected.found))
        survey.take(observation, inspected)
        frame_id, in_camera = item.frame_id, in_camera and item.in_camera
        progress()
    report = survey.report(str(bag.path), frame_id, rig, camera if in_camera else None, rules)
    if not report.frames:
        reasons = [*survey.refused, *skipped]
        reason = f' ({reasons[0]})' if reasons else ''
        raise CloudError(
            f'{bag.path}: no cloud in it could be inspected{reason}: check the clouds'
        )
    covered = coverages_of(bag)
    frames = tuple(
        frame if frame.stamp_ns is None else replace(frame, coverage=covered.get(frame.stamp_ns))
        for frame in report.frames
    )
    return replace(report, frames=frames, skipped=tuple(skipped))


def _observation(item: BagCloud) -> SeenCloud:
    return SeenCloud(
        name=f'{item.stamp_ns / 1e9:.3f} s',
        cloud=item.cloud,
        stamp_ns=item.stamp_ns,
        viewpoint=(0.0, 0.0, 0.0) if item.in_camera else viewpoint_of(item.cloud),
        pose=IDENTITY if item.pose is None else item.pose,
        vehicle=item.vehicle,
        covariance=item.covariance,
        photograph=item.photograph,
    )
