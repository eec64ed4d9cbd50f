"""The clouds of a bag, inspected."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from ftp_dent_ros.cloud.coverage import Coverage
from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.dents.rules import Rules
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
    inspector = CloudInspector(inspect, count, placed=tagged, settings=settings)
    covered = coverages_of(bag)
    frame_id, in_camera = '', True
    skipped: list[str] = []
    read: deque[tuple[BagCloud, SeenCloud]] = deque()

    def tasks() -> Iterator[Task]:
        for item in bag_clouds(bag, skipped.append):
            seen = seen_cloud(item, covered)
            read.append((item, seen))
            yield seen.cloud, seen.viewpoint

    for inspected in each(inspector.inspect, tasks()):
        item, seen = read.popleft()
        inspector.take(seen, inspected)
        frame_id, in_camera = item.frame_id, in_camera and item.in_camera
        progress()
    camera = camera if in_camera else None
    return inspector.report(str(bag.path), frame_id, rig, camera, rules, skipped)


def seen_cloud(item: BagCloud, covered: Mapping[int, Coverage]) -> SeenCloud:
    """A cloud of a bag as it is inspected, with its coverage of all by their stamps."""
    return SeenCloud(
        name=f'{item.stamp_ns / 1e9:.3f} s',
        cloud=item.cloud,
        stamp_ns=item.stamp_ns,
        viewpoint=(0.0, 0.0, 0.0) if item.in_camera else viewpoint_of(item.cloud),
        pose=IDENTITY if item.pose is None else item.pose,
        vehicle=item.vehicle,
        covariance=item.covariance,
        coverage=covered.get(item.stamp_ns),
        photograph=item.photograph,
    )
