"""Bags to one survey: all poses, then what clouds tell together, then dents and the picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros import __version__
from ftp_dent_ros.cloud.seen import SeenCloud
from ftp_dent_ros.dents.dent import MeasuredDent, SmallestDent
from ftp_dent_ros.dents.dent_list import EXACT, DentList, position_covariance
from ftp_dent_ros.dents.glass import sentence
from ftp_dent_ros.dents.rules import Rules
from ftp_dent_ros.dents.sightings import ListedDent
from ftp_dent_ros.errors import BagError, CloudError
from ftp_dent_ros.inspection.inspecting import CloudInspector, Inspected, inspected
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.report import InspectionReport
from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.recording.clouds import bag_clouds, coverages_of
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig.rig import Lens
from ftp_dent_ros.survey.footprint import unrolled
from ftp_dent_ros.survey.fusion import PIXEL, Fusion
from ftp_dent_ros.survey.joining import UNPLACED, Joining
from ftp_dent_ros.survey.mosaic import Mosaic
from ftp_dent_ros.survey.result import DentRelief, SurveyedDent, SurveyResult
from ftp_dent_ros.survey.writing import Surveyed, skin_of

# Of a pose that says nothing of its accuracy: metres, radians; more than the dent list takes.
_UNKNOWN = np.diag([0.03**2] * 3 + [0.015**2] * 3)


def survey_bags(
    bags: Sequence[Bag],
    name: str,
    settings: SmallestDent,
    rig_id: str,
    progress: Callable[[], Any],
) -> list[Surveyed]:
    """Make one skin of the clouds of all bags, which show one aircraft.

    Parameters
    ----------
    bags : sequence of Bag
    name : str
    settings : SmallestDent
        The smallest dents that are looked for.
    rig_id : str
        Id of the calibration.
    progress : callable
        Called after each cloud, three times for each.

    Returns
    -------
    list of Surveyed
        A survey of each part that nothing ties to the others, that of most clouds first.

    Raises
    ------
    BagError
        A bag has no clouds in the camera's frame, or poses in another map than the others.
    CloudError
        No cloud can be used.
    """
    parts = join_bags(bags, progress).parts()
    names = [name, *(f'{name}, part {number}' for number in range(2, len(parts) + 1))]
    return [
        _surveyed(bags, part, each, settings, rig_id, progress)
        for part, each in zip(parts, names, strict=True)
    ]


def _surveyed(
    bags: Sequence[Bag],
    joined: Joining,
    name: str,
    settings: SmallestDent,
    rig_id: str,
    progress: Callable[[], Any],
) -> Surveyed:
    """Survey of one part."""
    skin = FusedSkin(bags, joined, progress)
    dents = DentList()
    for item, outcome in skin.inspected(settings, photographs=False):
        found = outcome.found
        if found is None:
            joined.remarks.append(f'cloud at {item.stamp_ns / 1e9:.3f} s: {outcome.reason}')
            continue
        pose, number = item.pose or IDENTITY, joined.numbers[item.stamp_ns]
        seen = [each.transformed(pose) for each in (*found.dents, *found.others)]
        dents.add(number, seen, pose, item.covariance, item.stamp_ns)
    surveyed = tuple(
        SurveyedDent(
            each.number,
            replace(each.dent, reason=each.reason),
            each.position_covariance,
            len(each.sightings),
            skin.relief(each.dent, each.best),
        )
        for each in (skin.placed(entry, entry.best) for entry in dents.entries)
    )
    joined.remarks[:0] = [sentence(dents.glass)] if dents.glass else []
    result = SurveyResult(
        name=name,
        sources=tuple(str(bag.path) for bag in bags),
        taken_ns=min(joined.numbers),
        frame_id=joined.frame_id,
        dents=surveyed,
        coverage=skin.mosaic.coverage(),
        settings=settings,
        rig_id=rig_id,
        software=__version__,
    )
    return Surveyed(result, skin.mosaic, joined)


def join_bags(
    bags: Sequence[Bag],
    progress: Callable[[], Any] = lambda: None,
) -> Joining:
    """Join all clouds of all bags, which show one aircraft.

    Parameters
    ----------
    bags : sequence of Bag
    progress : callable
        Called after each cloud.

    Raises
    ------
    BagError
        A bag has no clouds in the camera's frame, or poses in another map than the others.
    CloudError
        No cloud can be used, or nothing tells how they lie.
    """
    joining, unused, without_covariance = Joining(), Counter[str](), 0

    def leave_out(sentence: str) -> None:
        """Keep what tells of one cloud, and count its reason."""
        joining.remarks.append(sentence)
        unused[sentence.partition(': ')[2]] += 1

    for flight, bag in enumerate(bags):
        for item in bag_clouds(bag, leave_out, False, unplaced=True):
            if not item.in_camera:
                raise BagError(
                    f'{bag.path}: has its clouds in {item.frame_id} alone: record /points too'
                )
            if item.stamp_ns in joining.numbers:
                leave_out(f'cloud at {item.stamp_ns / 1e9:.3f} s: is in another bag already')
                continue
            covariance = item.covariance
            if item.pose is not None:
                if joining.frame_id not in (UNPLACED, item.frame_id):
                    raise BagError(
                        f'{bag.path}: its poses are in {item.frame_id!r}, those before in '
                        f'{joining.frame_id!r}: survey them one by one'
                    )
                joining.frame_id = item.frame_id
                if covariance is None or not np.any(covariance):
                    covariance, without_covariance = _UNKNOWN, without_covariance + 1
            try:
                joining.add(item.stamp_ns, item.cloud, item.pose, covariance, flight)
            except CloudError as reason:
                leave_out(f'cloud at {item.stamp_ns / 1e9:.3f} s: {reason}')
            progress()
    if not joining.numbers:
        why = next(iter(unused), 'check the clouds')
        raise CloudError(f'{bags[0].path}: no cloud in it can be used: {why}')
    joining.finish()
    parts, clouds, without_skin = joining.parts(), len(joining.numbers), joining.without_skin
    unplaced = sum(node.covariance is None for node in joining.graph.nodes)
    if len(parts) > 1 and unplaced == without_skin == clouds:
        raise CloudError(
            f'{bags[0].path}: has neither poses nor images of the skin, and its shape alone does '
            'not tell how the clouds lie: record /skin and /tagged/camera_pose too'
        )
    loose = clouds - sum(np.bincount(part.graph.groups()).max() for part in parts)
    days = (max(joining.numbers) - min(joining.numbers)) // 86_400_000_000_000
    # First what is said of the whole, then cloud by cloud.
    said = (
        (
            len(parts) > 1,
            f'the clouds are not one skin but {len(parts)} parts, the largest of '
            f'{len(parts[0].numbers)} of {clouds} clouds: only the autopilot tells how these lie '
            'to each other, if anything does, so that each is surveyed by itself',
        ),
        (
            loose,
            f'{loose} of {clouds} clouds are tied to the most of theirs by poses alone: what '
            'they show is not averaged with it, and their dents lie as well as the poses do',
        ),
        (
            days,
            f'{days} days are between the first cloud and the last: what has changed between '
            'them is averaged; survey the flights one by one, and compare',
        ),
        (
            unplaced,
            f'{unplaced} of {clouds} clouds have no pose: they are placed by what they share with '
            f'the others alone{"" if unplaced < clouds else ", in a frame of their own"}',
        ),
        (
            without_covariance,
            f'{without_covariance} poses do not state how good they are: 30 mm is taken',
        ),
        (
            without_skin,
            f'{without_skin} of {clouds} clouds have no image of the skin: along the skin only '
            f'{"the autopilot" if unplaced < clouds else "their shape"} tells where they lie; '
            'record /skin too',
        ),
        *((n, f'{n} clouds or messages are not used: {why}') for why, n in unused.items()),
    )
    joining.remarks[:0] = [text for count, text in said if count]
    return joining


class FusedSkin:
    """What all clouds of some bags tell together, and the picture that they make.

    Parameters
    ----------
    bags : sequence of Bag
    joined : Joining
        Of their clouds.
    progress : callable
        Called after each cloud.
    """

    def __init__(self, bags: Sequence[Bag], joined: Joining, progress: Callable[[], Any]) -> None:
        self._bags, self._joined, self._progress = bags, joined, progress
        skin, places = unrolled(joined.footprints, joined.graph.poses)
        #: Number of the group of each cloud: what is not tied is not averaged.
        self._groups = joined.graph.groups()
        self.mosaic, sizes = Mosaic(skin, *_extent(places)), np.bincount(self._groups)
        # Where several groups lie, the largest is drawn.
        for number in np.lexsort((self._groups, sizes[self._groups])):
            self.mosaic.claim(places[number], self._groups[number])
        # What the clouds of a group tell together: of one by itself there is none.
        self._fusions = {
            group: Fusion(
                skin, *_extent([places[k] for k in np.flatnonzero(self._groups == group)])
            )
            for group in np.flatnonzero(sizes > 1)
        }
        for item, pose, number in self._clouds(False):
            fusion = self._fusions.get(self._groups[number])
            if fusion:
                fusion.add(item.cloud, pose)
            progress()

    def _clouds(self, photographs: bool) -> Iterator[tuple[SeenCloud, Pose, int]]:
        """The clouds that were joined, each the first time that it comes, poses and numbers."""
        graph, numbers = self._joined.graph, dict(self._joined.numbers)
        for flight in sorted({node.flight for node in graph.nodes}):
            bag = self._bags[flight]
            for item in bag_clouds(bag, photographs=photographs, unplaced=True):
                number = numbers.pop(item.stamp_ns, None)
                if number is not None:
                    yield item, graph.pose(number), number

    def inspected(
        self, settings: SmallestDent, photographs: bool = True
    ) -> Iterator[tuple[SeenCloud, Inspected]]:
        """Each cloud, its points those of all clouds, and its dents; the picture is drawn with it.

        Poses are as uncertain as seen from the middle one of those that are tied to the most.
        """
        most = np.flatnonzero(self._groups == np.bincount(self._groups).argmax())
        # That one is exact: zeros would say that nothing is known of it.
        among_them = EXACT + self._joined.graph.covariances(anchor=int(most[len(most) // 2]))
        for item, pose, number in self._clouds(photographs):
            fusion, covariance = self._fusions.get(self._groups[number]), among_them[number]
            cloud = fusion.fused(item.cloud, pose) if fusion else item.cloud
            placed = replace(item, cloud=cloud, pose=pose, vehicle=pose, covariance=covariance)
            outcome = inspected(inspect, settings, (cloud, np.zeros(3)))
            self.mosaic.add(cloud, pose, outcome.found, self._groups[number])
            yield placed, outcome
            self._progress()

    def placed(self, entry: ListedDent, number: int) -> ListedDent:
        """An entry that a cloud shows best, as uncertain as that cloud's place is.

        It is in doubt where more clouds than are tied to that one show the place.
        """
        dent, joined = entry.dent, self._joined
        known = joined.graph.pose(number), joined.covariances[number]
        owner, sizes = self.mosaic.owner(dent.position), np.bincount(self._groups)
        if owner >= 0 and sizes[owner] > sizes[self._groups[number]]:
            doubt = (
                'only poses tell where it lies, and others show that place: may be one of theirs'
            )
            dent = replace(dent, reason='; '.join(filter(None, (dent.reason, doubt))))
        spread = position_covariance(dent.position, *known)
        return replace(entry, dent=dent, position_covariance=spread)

    def relief(self, dent: MeasuredDent, number: int) -> DentRelief | None:
        """The skin about a dent by what is tied to a cloud; None if nothing is, or it is cut."""
        fusion = self._fusions.get(self._groups[number])
        is_known = not dent.is_cut and dent.length.is_measured and dent.width.is_measured
        if fusion is None or not is_known:
            return None
        # Of the skin that is kept about a dent: times the dent's own sizes, metres beside them,
        # and points across, at most.
        halves = np.array([dent.length.value, dent.width.value]) / 2 * 1.5 + 0.006
        spacing = max(PIXEL, 2 * float(halves.max()) / 80)
        columns, rows = np.ceil(halves / spacing).astype(int)
        empty = np.full((2 * rows + 1, 2 * columns + 1), np.nan, np.float32)
        plane = DentRelief(spacing, empty).plane(dent)
        heights = (fusion.heights(plane) - dent.position) @ dent.normal
        return DentRelief(spacing, heights.astype(np.float32))


def _extent(places: Sequence[NDArray[np.float32]]) -> tuple[NDArray, NDArray]:
    """Least and largest x and y of clouds' places, with some room, metres."""
    flat = np.concatenate(places)[:, :2].astype(float)
    return flat.min(axis=0) - 0.05, flat.max(axis=0) + 0.05


def report_on_skin(
    bag: Bag,
    rig: tuple[str, str] = ('', ''),
    camera: Lens | None = None,
    rules: Rules | None = None,
    settings: SmallestDent | None = None,
    progress: Callable[[], Any] = lambda: None,
) -> tuple[InspectionReport, Joining]:
    """Join a bag's clouds, inspect each with what all tell of its place, and show the whole skin.

    Of several parts that nothing ties, that of most clouds.

    Parameters
    ----------
    bag : Bag
    rig, camera, rules, settings
        As `ftp_dent_ros.inspection.inspecting.survey_bag` has them.
    progress : callable
        Called after each cloud, three times for each.

    Raises
    ------
    BagError
        It has no clouds in the camera's frame, or is damaged.
    CloudError
        No cloud in it could be used.
    """
    joined, *others = join_bags([bag], progress).parts()
    if others:
        count = sum(len(each.numbers) for each in others)
        joined.remarks.insert(0, f'{count} clouds of other parts are not in this report')
    skin = FusedSkin([bag], joined, progress)
    inspector = CloudInspector(inspect, len(joined.numbers), settings=settings)
    covered = coverages_of(bag)
    for item, outcome in skin.inspected(settings or SmallestDent()):
        coverage = covered.get(item.stamp_ns)
        inspector.take(replace(item, frame_id=joined.frame_id, coverage=coverage), outcome)
    report = inspector.report(str(bag.path), rig, camera, rules)
    numbers = [joined.numbers[each.stamp_ns or 0] for each in report.frames]
    frames = tuple(
        replace(each, covariance=joined.covariances[number])
        for each, number in zip(report.frames, numbers, strict=True)
    )
    entries = tuple(skin.placed(each, numbers[each.best - 1]) for each in report.entries)
    facts = [('Joined by', '{} pairs of clouds, {} left out'.format(*joined.pairs))]
    shown = skin_of(skin.mosaic, entries, facts, joined.remarks)
    return replace(report, frames=frames, entries=entries, skin=shown), joined
