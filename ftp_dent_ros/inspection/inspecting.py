"""From the clouds of a flight, one after the other, to what is reported of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.cloud.cloud import Cloud, check_resolution
from ftp_dent_ros.cloud.seen import CAMERA_FRAME, SeenCloud
from ftp_dent_ros.dents.dent import Inspection, SmallestDent
from ftp_dent_ros.dents.dent_list import EXACT, DentList
from ftp_dent_ros.dents.glass import sentence
from ftp_dent_ros.dents.rules import Rules
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.errors import CloudError, FtpDentError
from ftp_dent_ros.inspection.report import (
    DrawnCloud,
    InspectionReport,
    ReportedCloud,
    away_from_camera,
    findable_shares,
    mesh_of,
)
from ftp_dent_ros.pages.drawing import jpeg
from ftp_dent_ros.pose import IDENTITY
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.robust import median

if TYPE_CHECKING:
    from ftp_dent_ros.recording.reader import Bag

Inspect = Callable[..., Inspection]
#: A cloud, and from where it was seen in its own frame (metres): plain data, that another process
#: can be given.
Task = tuple[Cloud, ArrayLike]
#: As `map`: where clouds are inspected, and how many of them at once.
Each = Callable[[Callable[[Task], 'Inspected'], Iterable[Task]], Iterator['Inspected']]


class CloudInspector:
    """Inspects clouds and keeps what a report needs, however many they are.

    Parameters
    ----------
    inspect : callable
        `ftp_dent_ros.inspection.measuring.inspection.inspect`.
    clouds : int
        How many clouds are about to come, to share the 3-D view's points between them.
    placed : bool
        Whether all clouds' poses are known, so that a dent can be seen again.
    settings : SmallestDent, optional
    """

    def __init__(
        self,
        inspect: Inspect,
        clouds: int = 1,
        placed: bool = True,
        settings: SmallestDent | None = None,
    ) -> None:
        self._settings = settings or SmallestDent()
        #: Inspects a task, in whatever process.
        self.inspect = partial(inspected, inspect, self._settings)
        self._placed = placed
        # Of the 3-D view: in one cloud, and in all of them.
        self._vertices = max(400, min(16_000, 120_000 // max(clouds, 1)))
        self._frame_id, self._in_camera = CAMERA_FRAME, True
        self._lists: list[DentList] = []
        self._frames: list[ReportedCloud] = []
        self.refused: list[str] = []

    def add(self, observation: SeenCloud) -> Inspection | None:
        """Inspect one cloud; None if it is refused, and its reason is kept.

        Returns
        -------
        Inspection or None
            In the cloud's own frame.
        """
        return self.take(observation, self.inspect(task_of(observation)))

    def take(self, observation: SeenCloud, inspected: Inspected) -> Inspection | None:
        """Keep what came of a cloud's task; as `add` does. In the order of the tasks."""
        found = inspected.found
        if found is None:
            self.refused.append(f'{observation.name}: {inspected.reason}')
            return None
        number = len(self._frames) + 1
        dents = (*found.dents, *found.others)
        if not (self._placed and self._lists):
            self._lists.append(DentList())
        is_new = self._lists[-1].add(
            number,
            [dent.transformed(observation.pose or IDENTITY) for dent in dents],
            observation.vehicle,
            EXACT if observation.vehicle is None else observation.covariance,
            observation.stamp_ns or None,
        )
        if not is_new:
            self.refused.append(f'{observation.name}: the same cloud once more: counted once')
            return None
        self._frames.append(_frame(number, observation, found, self._vertices))
        self._frame_id = observation.frame_id
        self._in_camera &= observation.in_camera
        self._keep_views(observation, found)
        return found

    def report(
        self,
        source: str,
        rig: tuple[str, str] = ('', ''),
        camera: Lens | None = None,
        rules: Rules | None = None,
        skipped: Iterable[str] = (),
    ) -> InspectionReport:
        """What was found.

        Parameters
        ----------
        source : str
        rig : (str, str)
            The calibration's name and id.
        camera : Lens, optional
            Of that rig, to draw the dents into the photographs of clouds in its frame.
        rules : Rules, optional
            The user's limits.
        skipped : iterable of str
            Messages of a bag that could not be used.

        Raises
        ------
        CloudError
            No cloud could be inspected.
        """
        skipped, several = tuple(skipped), len(self._frames) > 1
        if not self._frames:
            reason = ''.join(f' ({each})' for each in [*self.refused, *skipped][:1])
            raise CloudError(
                f'{source}: no cloud in it could be inspected{reason}: check the clouds'
            )
        marks = [mark for each in self._lists for mark in each.glass]
        remarks = [sentence(marks)] if marks else []
        if several and not self._placed:
            remarks.append(
                'no poses tell how the clouds lie: each is listed by itself, and what several '
                'show counts several times; `ftp-dent survey` joins them by the skin they share'
            )
        return InspectionReport(
            source=source,
            frame_id=self._frame_id,
            frames=tuple(self._frames),
            entries=self._entries(),
            settings=self._settings,
            rig_name=rig[0],
            rig_id=rig[1],
            camera=camera if self._in_camera else None,
            rules=rules,
            refused=tuple(self.refused),
            skipped=skipped,
            placed=self._placed,
            remarks=tuple(remarks),
        )

    def _entries(self) -> tuple[ListedDent, ...]:
        """Numbered from 1, the deepest dent first, what is no dent after them."""
        entries = [(k, e) for k, each in enumerate(self._lists) for e in each.entries]
        entries.sort(key=lambda item: (item[1].dent.kind != 'dent', -item[1].dent.depth.value))
        numbers = {(k, entry.number): i for i, (k, entry) in enumerate(entries, start=1)}
        return tuple(
            replace(
                entry,
                number=numbers[k, entry.number],
                maybe=tuple(sorted(numbers[k, other] for other in entry.maybe)),
            )
            for k, entry in entries
        )

    def _keep_views(self, observation: SeenCloud, found: Inspection) -> None:
        """Keep the maps of the frames alone that show some dent best, the last one's too."""
        best = {entry.best for entry in self._entries()}
        if not best:
            # The maps of so many frames are kept, whatever else they show, where there are no
            # dents.
            best = {frame.number for frame in self._frames[:1]}
        last = self._frames[-1]
        if last.number in best:
            self._frames[-1] = replace(last, view=_view(observation, found))
        self._frames = [
            frame if frame.number in best else replace(frame, view=None) for frame in self._frames
        ]


def _frame(number: int, observation: SeenCloud, found: Inspection, vertices: int) -> ReportedCloud:
    cloud, covariance = observation.cloud, observation.covariance
    return ReportedCloud(
        number=number,
        name=observation.name,
        stamp_ns=observation.stamp_ns or None,
        area=area_of(cloud.points),
        noise=median(found.noise[np.isfinite(found.noise)]),
        findable=findable_shares(found.findable),
        waviness=found.waviness,
        dents=len(found.dents),
        others=len(found.others),
        mesh=mesh_of(cloud.points, found.deviation, observation.pose or IDENTITY, vertices),
        pose=observation.vehicle,
        covariance=None if covariance is None or not covariance.any() else covariance,
        coverage=observation.coverage,
    )


def _view(observation: SeenCloud, found: Inspection) -> DrawnCloud:
    photograph = observation.photograph
    return DrawnCloud(
        observation.cloud.points,
        found.deviation,
        observation.pose or IDENTITY,
        None if photograph is None else jpeg(photograph),
        (0, 0) if photograph is None else (photograph.shape[1], photograph.shape[0]),
    )


def area_of(points: NDArray[np.float32]) -> float:
    """Area of a cloud's whole cells, square metres."""
    right, down = points[:-1, 1:] - points[:-1, :-1], points[1:, :-1] - points[:-1, :-1]
    return float(np.nansum(np.linalg.norm(np.cross(right, down), axis=-1)))


@dataclass(frozen=True, eq=False)
class Inspected:
    """What came of a task.

    Attributes
    ----------
    found : Inspection, optional
        In the cloud's own frame; None if it cannot be inspected.
    reason : str
        Why it cannot be inspected.
    """

    found: Inspection | None = None
    reason: str = ''


def inspected(inspect: Inspect, settings: SmallestDent, task: Task) -> Inspected:
    """Inspect a cloud."""
    cloud, viewpoint = task
    try:
        found = inspect(check_resolution(cloud), settings=settings, viewpoint=viewpoint)
    except FtpDentError as error:
        return Inspected(reason=str(error))
    except Exception as error:
        # One cloud must not cost the report on all the others.
        return Inspected(
            reason='could not be inspected, by a defect of the software '
            f'({type(error).__name__}: {error}): report it with the cloud'
        )
    return Inspected(found)


def task_of(observation: SeenCloud) -> Task:
    """A cloud, and a point on its camera's side, shape (3,), metres, in the cloud's frame."""
    cloud = observation.cloud
    if observation.in_camera:
        return cloud, np.zeros(3)
    away = away_from_camera(cloud.points.astype(float))
    away = away[np.isfinite(away).all(axis=-1)].sum(axis=0)
    length, valid = np.linalg.norm(away), cloud.points[cloud.valid]
    if not length or not len(valid):
        return cloud, np.zeros(3)
    return cloud, np.median(valid, axis=0) - away / length


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
    # Only this needs the libraries of bags.
    from ftp_dent_ros.recording.clouds import bag_clouds, count_clouds, coverages_of

    count, tagged = count_clouds(bag)
    inspector = CloudInspector(inspect, count, placed=tagged, settings=settings)
    covered = coverages_of(bag)
    skipped: list[str] = []
    read: deque[SeenCloud] = deque()

    def tasks() -> Iterator[Task]:
        for item in bag_clouds(bag, skipped.append):
            read.append(replace(item, coverage=covered.get(item.stamp_ns)))
            yield task_of(item)

    for inspected in each(inspector.inspect, tasks()):
        inspector.take(read.popleft(), inspected)
        progress()
    return inspector.report(str(bag.path), rig, camera, rules, skipped)
