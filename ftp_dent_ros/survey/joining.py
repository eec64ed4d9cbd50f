"""Clouds as they come, each laid on those that it overlaps, and all their poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from itertools import pairwise
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import IDENTITY, Pose
from ftp_dent_ros.rigid import seen_along
from ftp_dent_ros.survey.footprint import Footprint
from ftp_dent_ros.survey.information import RelativePose
from ftp_dent_ros.survey.patch import SkinPatch, folded, patch_of, unfolded
from ftp_dent_ros.survey.pose_graph import JITTER, UNKNOWN, Node, PairLink, PoseGraph
from ftp_dent_ros.survey.registration import UnlikePairError, laid_over, register
from ftp_dent_ros.survey.tying import REACH, agreeing

#: Frame of a survey that no autopilot has placed.
UNPLACED = 'survey'
# Earlier clouds that each is laid on: the one before, and one some clouds back.
_BACK = (1, 3)


class Joining:
    """Joins clouds to one skin.

    Attributes
    ----------
    graph : PoseGraph
    numbers : dict of int to int
        Number of each cloud, from 0, by its stamp (ns).
    without_skin : int
        Clouds without an image of the skin.
    footprints : list of Footprint
    frame_id : str
        Of the poses.
    remarks : list of str
        What could not be used, and why; what was assumed.
    """

    def __init__(self) -> None:
        self.graph, self.frame_id = PoseGraph(), UNPLACED
        self.numbers: dict[int, int] = {}
        self.without_skin = 0
        self.remarks: list[str] = []
        # Those that clouds to come may be laid on.
        self._kept: dict[int, Callable[[], SkinPatch]] = {}
        # The last one that was laid on another pass, if any.
        self._closed: list[int] = []
        # Pairs that may tie two flights, if others say the same.
        self._maybe: dict[tuple[int, int], list[PairLink]] = {}
        self.footprints: list[Footprint] = []

    def add(
        self,
        stamp_ns: int,
        cloud: Cloud,
        pose: Pose | None = None,
        covariance: NDArray[np.float64] | None = None,
        flight: int = 0,
    ) -> Pose:
        """Where another cloud's camera was.

        Parameters
        ----------
        stamp_ns : int
        cloud : Cloud
            In its camera's frame.
        pose : Pose, optional
            Of the camera, as the autopilot says.
        covariance : ndarray, shape (6, 6), optional
            Of that pose; only with one.
        flight : int
            Number of the flight: the autopilot's errors of two are not alike.

        Raises
        ------
        CloudError
            The cloud has too few points, or they are no skin.
        """
        # What cannot be joined changes nothing.
        patch = patch_of(cloud)
        footprint = Footprint.of(cloud, patch)
        self.without_skin += patch.light is None
        number = len(self.graph.nodes)
        guess = self._guess(pose, flight)
        if number and pose is not None and not self.graph.placed:
            # Those before lie where this one does.
            move = guess @ self.graph.pose(-1).inverse()
            for before in range(number):
                self.graph.put(before, move @ self.graph.pose(before))
        self.graph.add(Node(pose, covariance, stamp_ns / 1e9, flight), guess)
        self.numbers[stamp_ns] = number
        self.footprints.append(footprint)
        self._kept[number] = lambda: patch
        self._follow(number)
        self._close(number)
        self._search(number)
        self.graph.update()
        self._forget(number)
        return self.graph.pose(number)

    def finish(self) -> None:
        """Move all poses to where they agree best, and tell what was left out.

        No cloud is to come: what later ones could be laid on is forgotten.
        """
        self._kept.clear()
        self.graph.settle()
        self.remarks += self.contradicting().values()

    def parts(self) -> list[Joining]:
        """What something ties, each by itself, the part of most clouds first.

        Clouds are tied by what they share; and those of a flight that have poses, by these.
        """
        flights = self.graph.placed.values()
        found = self.graph.groups([pair for placed in flights for pair in pairwise(placed)])
        return [
            self._part(np.flatnonzero(found == part).tolist())
            for part in np.argsort(-np.bincount(found), kind='stable')
        ]

    def _part(self, numbers: list[int]) -> Joining:
        """Some of the clouds, numbered anew."""
        part, stamps = Joining(), list(self.numbers)
        part.graph = self.graph.part(numbers)
        part.numbers = {stamps[number]: index for index, number in enumerate(numbers)}
        part.footprints = [self.footprints[number] for number in numbers]
        if part.graph.placed:
            part.frame_id = self.frame_id
        part.remarks = list(self.remarks)
        return part

    def contradicting(self) -> dict[int, str]:
        """Which pairs are left out at the moment, by their number."""
        why, links = 'contradicts the others, and is left out', self.graph.links
        return {
            k: self._about(links[k].first, links[k].second, why)
            for k in sorted(self.graph.left_out)
        }

    @property
    def pairs(self) -> tuple[int, int]:
        """How many relative poses join the clouds, and how many contradict those."""
        left_out = len(self.graph.left_out)
        return len(self.graph.links) - left_out, left_out

    @cached_property
    def covariances(self) -> NDArray[np.float64]:
        """Of all poses in the map, shape (n, 6, 6), once no cloud is to come."""
        return self.graph.covariances()

    def _guess(self, stated: Pose | None, flight: int) -> Pose:
        if not self.graph.nodes:
            return stated or IDENTITY
        last, there = self.graph.nodes[-1], self.graph.pose(-1)
        if stated is None:
            return there
        if last.stated is None or last.flight != flight:
            return stated
        return there @ last.stated.inverse() @ stated

    def _follow(self, number: int) -> None:
        """Lay a cloud on those before it in its flight."""
        before = [k for k in self._kept if number - k in _BACK and not self._are_passes(k, number)]
        for first in reversed(before):
            relative = self._laid(first, number)
            if relative is not None:
                self.graph.links.append(PairLink(first, number, relative))
                # A guess for the others that is nearly right.
                if number - first == 1 and relative.rank == 6:
                    self.graph.put(number, self.graph.pose(first) @ relative.pose)

    def _laid(self, first: int, second: int, is_far: bool = False) -> RelativePose | None:
        """Pose of a cloud seen from an earlier one, however far off; None if it does not fit."""
        graph, patches = self.graph, (self._kept[first](), self._kept[second]())
        guess = graph.pose(first).inverse() @ graph.pose(second)
        if is_far:
            guess = laid_over(*patches, guess)
        try:
            relative = register(*patches, guess, doubt_by_autopilot(graph, first, second))
            why = '' if patches[1].light is None else relative.remark
        except UnlikePairError as reason:
            relative, why = None, str(reason)
        if why and second - first == 1 and not is_far:
            self.remarks.append(self._about(first, second, why))
        return relative

    def _forget(self, number: int) -> None:
        """Keep the last patches, and of the others as many as later passes need."""
        old, nodes = number - max(_BACK), self.graph.nodes
        if old < 0:
            return
        earlier = [k for k in self._kept if k < old and nodes[k].flight == nodes[old].flight]
        # A cloud is kept for later passes where the nearest that is kept is this part of a patch
        # away.
        if self._nearest(old, earlier)[1] < 0.3 * self.footprints[old].size:
            del self._kept[old]
        else:
            self._kept[old] = partial(unfolded, folded(self._kept[old]()))

    def _close(self, number: int) -> None:
        """Lay a cloud on the nearest one of another pass that shows the same skin."""
        size, passes = self.footprints[number].size, partial(self._are_passes, number)
        lately = [each for each in self._closed if not passes(each)]
        # Pairs on the same skin err alike, and tell alike: this part of a patch from the last that
        # was laid, one tells hardly more.
        if self._nearest(number, lately)[1] < 0.5 * size:
            return
        nearest, far = self._nearest(number, [each for each in self._kept if passes(each)])
        # No farther apart than this part of both patches' sizes.
        if far > 0.6 * (size + self.footprints[nearest].size):
            return
        relative = self._laid(nearest, number)
        if relative is None:
            return
        self._closed = [number]
        # Where marks do not tell how far another pass is slid along this one, the autopilot alone
        # does. Pairs share its error, and many would be too sure of it.
        if relative.rank == 6:
            self.graph.links.append(PairLink(nearest, number, relative))

    def _search(self, number: int) -> None:
        """Look for the skin of a cloud in other flights, as far off as their poses state.

        What pairs say alike ties the flights; what one says may be chance.
        """
        graph, flight = self.graph, self.graph.nodes[number].flight
        others = [each for each in self._kept if graph.nodes[each].flight != flight]
        if not others:
            return
        groups, far = graph.groups(), self._distances(number, others)
        spread = doubt_by_autopilot(graph, others[-1], number)[:3, :3]
        # Standard deviations, and parts of two patches.
        reach = 4 * math.sqrt(np.linalg.eigvalsh(spread)[-1]) + 1.2 * self.footprints[number].size
        within = np.array(others)[(groups[others] != groups[number]) & (far < reach)].tolist()
        # So many at once, others each time.
        every = max(1, math.ceil(len(within) / 4))
        for other in within[number % every :: every]:
            relative = self._laid(other, number, is_far=True)
            if relative is None or relative.remark or relative.rank < 6:
                continue
            found = self._maybe.setdefault((graph.nodes[other].flight, flight), [])
            found.append(PairLink(other, number, relative))
            motions = [
                graph.pose(link.first) @ link.relative.pose @ graph.pose(link.second).inverse()
                for link in found
            ]
            pieces = np.array([link.second for link in found])
            # What is wrong lies anywhere on the disc that is searched.
            chance = (REACH / reach) ** 2
            same = agreeing(motions, self._middles(pieces.tolist()), pieces[:, None], chance)
            if len(found) - 1 in same:
                graph.links.append(found[-1])

    def _middles(self, numbers: Sequence[int]) -> NDArray[np.float64]:
        """Middles of some clouds in the map, shape (n, 3)."""
        at = np.asarray(numbers, np.intp)
        middles = np.stack([self.footprints[each].middle for each in numbers])
        return (self.graph.turns[at] @ middles[..., None])[..., 0] + self.graph.places[at]

    def _distances(self, number: int, others: Sequence[int]) -> NDArray[np.float64]:
        """From the middle of a cloud to those of others, metres."""
        places = self._middles([*others, number])
        return np.linalg.norm(places[:-1] - places[-1], axis=1)

    def _nearest(self, number: int, others: Sequence[int]) -> tuple[int, float]:
        """The nearest of other clouds, and how far it is; infinitely far of none."""
        far = zip(others, self._distances(number, others).tolist(), strict=True)
        return min(far, key=itemgetter(1), default=(number, math.inf))

    def _are_passes(self, one: int, other: int) -> bool:
        nodes = self.graph.nodes
        return abs(one - other) >= 8 or nodes[one].flight != nodes[other].flight

    def _about(self, first: int, second: int, what: str) -> str:
        a, b = (self.graph.nodes[number].seconds for number in (first, second))
        return f'clouds {first + 1} and {second + 1} ({a:.3f} s and {b:.3f} s): {what}'


def doubt_by_autopilot(graph: PoseGraph, first: int, second: int) -> NDArray[np.float64]:
    """Covariance of the second camera's place seen from the first, by the autopilot alone.

    Or by how far a drone flies where that tells nothing. Along the first camera's axes, about the
    second camera, shape (6, 6).

    Parameters
    ----------
    graph : PoseGraph
    first, second : int
        Numbers of the clouds.
    """
    a, b = graph.nodes[first], graph.nodes[second]
    if a.covariance is None or b.covariance is None:
        # Of a cloud's place seen from the one before: metres, radians.
        return np.diag([0.08**2] * 3 + [0.03**2] * 3) * max(1, min(second - first, 3))
    kept = np.exp(-abs(b.seconds - a.seconds) / UNKNOWN[1, 0])
    changed = 1 - kept * (a.flight == b.flight)
    here, there = graph.pose(first), graph.pose(second)
    axes, arm = here.rotation.as_matrix(), there.translation - here.translation
    # The first one's turn moves what lies at the end of the arm.
    by_first = seen_along(a.covariance * changed + JITTER, axes, arm)
    return by_first + seen_along(b.covariance * changed + JITTER, axes, np.zeros(3))
