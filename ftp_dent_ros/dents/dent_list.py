"""The dents of several frames of one flight: a dent that is seen again is still one dent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from ftp_dent_ros.dents.constellation import GATE, SHARED, groups_shown
from ftp_dent_ros.dents.dent import Estimate, MeasuredDent, with_clearances
from ftp_dent_ros.dents.glass import Glass, Spot
from ftp_dent_ros.dents.sightings import (
    ListedDent,
    Sighting,
    agreement,
    assigned,
    line_along,
    listed,
    sigmas_apart,
)
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import about, move_about

# Standard uncertainty of a pose whose covariance is not known (all zeros, in ROS): metres,
# radians.
UNKNOWN_POSITION, UNKNOWN_ANGLE = 0.02, 0.01
# Of a pose that nothing is uncertain about: a cloud in its own frame.
EXACT = np.eye(6) * 1e-12


class DentList:
    """Dents over the frames of a flight, in one frame of reference (``map``).

    A frame lies where its dents lie on those of a group, and the group where its frames' poses
    have it in the mean. Frames that show no known dent begin another group, until one joins both.
    What keeps its place in the picture while the camera moves is of a glass, and not in the list.
    """

    def __init__(self) -> None:
        #: What was added, where it lies now.
        self.clouds: list[SeenDents] = []
        self._entries: list[ListedDent] = []
        self._numbers = self._groups = 0
        self._begun: dict[tuple[int, int], int] = {}
        # Of the last pose: shift, metres, and turn, radians.
        self._error = np.zeros(6)
        # Of each frame its group, and the middle of its dents: where its pose has it, and where it
        # was found to lie.
        self._placed: list[tuple[int, NDArray[np.float64], NDArray[np.float64]]] = []
        self._glass = Glass()

    @property
    def entries(self) -> tuple[ListedDent, ...]:
        """All that was found on the skin, with the clearances of this list."""
        known = [
            each
            for each in sorted(self._entries, key=lambda entry: entry.number)
            if not (each.dent.is_cut and any(_is_part(each, other) for other in self._entries))
        ]
        shifts = {entry.group: self._shift(entry.group) for entry in known}
        known = whole_steps([replace(e, dent=_shifted(e.dent, shifts[e.group])) for e in known])
        dents = with_clearances([each.dent for each in known])
        return tuple(
            replace(each, dent=dent, maybe=maybe)
            for each, dent, maybe in zip(known, dents, doubles(dents, known), strict=True)
        )

    @property
    def glass(self) -> tuple[Spot, ...]:
        """Marks on a glass of the camera or the projector, which are not in the list."""
        return self._glass.marks

    def _shift(self, group: int) -> NDArray[np.float64]:
        """From where a group lies to where its poses have it in the mean."""
        off = [stated - found for member, stated, found in self._placed if member == group]
        return np.mean(off, axis=0) if off else np.zeros(3)

    def copy(self) -> DentList:
        """The same list, to go on from another time."""
        other = DentList()
        other.__dict__.update({name: copy(value) for name, value in self.__dict__.items()})
        return other

    def numbered_as(self, other: DentList) -> DentList:
        """The same list, in which what begins a dent as in another list gets that one's number."""
        same = self.copy()
        same._numbers, same._begun = max(self._numbers, other._numbers), dict(other._begun)
        return same

    def add(
        self,
        frame: int,
        dents: Sequence[MeasuredDent],
        pose: Pose | None = None,
        covariance: NDArray[np.float64] | None = None,
        stamp_ns: int | None = None,
    ) -> bool:
        """Add what one frame shows; False if it was added before.

        Parameters
        ----------
        frame : int
            Number of the frame.
        dents : sequence of MeasuredDent
            In the list's frame of reference, where the pose puts them.
        pose : Pose, optional
            In it at that frame, about whose origin `covariance` turns.
        covariance : ndarray, shape (6, 6), optional
            Of the pose, as in geometry_msgs/PoseWithCovariance (x, y, z, and rotations about
            the fixed axes); none or all zeros is unknown, and then `UNKNOWN_POSITION` and
            `UNKNOWN_ANGLE` are taken.
        stamp_ns : int, optional
            Of the exposure: the same one is the same frame, whatever its number. The number by
            default.
        """
        stamp_ns = frame if stamp_ns is None else stamp_ns
        if any(each.stamp_ns == stamp_ns for each in self.clouds):
            return False
        cloud = SeenDents(frame, dents, pose, covariance, stamp_ns)
        # What cannot be added changes nothing.
        after = self.copy()
        after._add(cloud)
        self.__dict__.update(after.__dict__)
        return True

    def _add(self, cloud: SeenDents) -> None:
        self.clouds.append(cloud)
        before = self._glass.of_marks
        if cloud.pose is not None:
            stated = known_covariance(cloud.covariance)
            self._glass = self._glass.with_frame(cloud.frame, cloud.dents, cloud.pose, stated)
        if {each for each in self._glass.of_marks if each[0] != cloud.frame} == before:
            self._place(cloud)
            return
        # What is of a glass has had a say in where frames lie: once more without it.
        self._entries, self._placed, self._groups, self._error = [], [], 0, np.zeros(6)
        for each in self.clouds:
            self._place(each)

    def _place(self, cloud: SeenDents) -> None:
        """Put a frame in its place, and pair what it shows of the skin with what is known."""
        frame, pose, covariance = cloud.frame, cloud.pose, cloud.covariance
        of_marks = self._glass.of_marks
        kept = [i for i in range(len(cloud.dents)) if (frame, i) not in of_marks]
        dents = [cloud.dents[index] for index in kept]
        pivot = np.zeros(3) if pose is None else pose.translation
        doubt = known_covariance(covariance)
        expected = move_about(SHARED * self._error, pivot)
        known: dict[int, list[MeasuredDent]] = {}
        for entry in self._entries:
            known.setdefault(entry.group, []).append(entry.dent)
        matches = groups_shown(dents, known, pivot, doubt, expected)
        move = matches[0][1] if matches else expected
        self._error = np.concatenate([move.apply(pivot) - pivot, move.rotation.as_rotvec()])
        group = self._joined(matches)
        sightings = [
            Sighting(
                frame,
                dent.transformed(move),
                position_covariance(dent.position, pose, covariance),
            )
            for dent in dents
        ]
        if len(dents):
            stated = np.mean([dent.position for dent in dents], axis=0)
            self._placed.append((group, stated, move.apply(stated)))
        seen = [listed(0, (each,), group) for each in sightings]
        self._merge(seen, group, [(frame, index) for index in kept])

    def _merge(
        self, seen: Sequence[ListedDent], group: int, first: Sequence[tuple[int, int]] = ()
    ) -> None:
        """Take in what is seen of a group; what begins a dent has its number by the frame's."""
        pairs = paired(seen, self._entries, group)
        for index, each in enumerate(seen):
            if index in pairs:
                known = self._entries[pairs[index]]
                self._entries[pairs[index]] = known.with_sightings(each.sightings)
                continue
            number = each.number or self._begun.setdefault(first[index], self._numbers + 1)
            self._numbers = max(self._numbers, number)
            self._entries.append(replace(each, number=number))

    def _joined(self, matches: list[tuple[int, Pose]]) -> int:
        """The group that a frame belongs to, after it has made one of all those that it shows."""
        if not matches:
            self._groups += 1
            return self._groups
        (group, move), *others = matches
        for other, there in others:
            # From where the frame lies in the other group to where it does in this one.
            onto = move @ there.inverse()
            moved = [e.moved(onto, group) for e in self._entries if e.group == other]
            self._entries = [e for e in self._entries if e.group != other]
            self._placed = [
                (group, stated, onto.apply(found)) if member == other else (member, stated, found)
                for member, stated, found in self._placed
            ]
            self._merge(moved, group)
        return group


def _shifted(dent: MeasuredDent, shift: NDArray[np.float64]) -> MeasuredDent:
    return replace(dent, position=dent.position + shift, outline=dent.outline + shift)


def position_covariance(
    position: NDArray[np.float64],
    pose: Pose | None = None,
    covariance: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Covariance of a point that a pose places, shape (3, 3), square metres."""
    if covariance is None or not np.any(covariance):
        return np.eye(3) * UNKNOWN_POSITION**2
    jacobian = about(position - (0.0 if pose is None else pose.translation))
    return jacobian @ np.asarray(covariance, float).reshape(6, 6) @ jacobian.T


def known_covariance(covariance: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """The covariance of a pose's error, shape (6, 6), also where none is stated."""
    if covariance is None or not np.any(covariance):
        return np.diag([UNKNOWN_POSITION**2] * 3 + [UNKNOWN_ANGLE**2] * 3)
    # No pose is better than 1 mm, 0.5 mrad.
    return np.reshape(covariance, (6, 6)) + np.diag([1e-3**2] * 3 + [5e-4**2] * 3)


@dataclass(frozen=True, eq=False)
class SeenDents:
    """What one cloud shows.

    Attributes
    ----------
    frame : int
        Its number.
    dents : sequence of MeasuredDent
        Where the pose puts them.
    pose : Pose, optional
    covariance : ndarray, shape (6, 6), optional
    stamp_ns : int
        Of the exposure, or its number.
    """

    frame: int
    dents: Sequence[MeasuredDent]
    pose: Pose | None
    covariance: NDArray[np.float64] | None
    stamp_ns: int

    @property
    def places(self) -> NDArray[np.float64]:
        """Of its dents, shape (n, 3)."""
        return np.array([dent.position for dent in self.dents]).reshape(-1, 3)

    def placed(self, pose: Pose | None) -> SeenDents:
        """The same where another pose puts it, if there is one."""
        if pose is None or self.pose is None:
            return self
        move = pose @ self.pose.inverse()
        return replace(
            self,
            dents=[each.transformed(move) for each in self.dents],
            pose=pose,
        )


def paired(
    seen: Sequence[ListedDent], entries: Sequence[ListedDent], group: int
) -> dict[int, int]:
    """Which entry each dent is that was seen, by their indices: one of the other at most.

    Parameters
    ----------
    seen : sequence of ListedDent
        In their places in the group.
    entries : sequence of ListedDent
    group : int
    """
    if not (len(seen) and len(entries)):
        return {}
    places, there = (np.stack([e.dent.position for e in each]) for each in (seen, entries))
    # Farther from each other than this no pose puts one dent, and its length; metres.
    near = cdist(places, there) <= 1.0 + _longest(seen, entries)
    # All else is of those nearby: it costs the same however many there are.
    at = np.flatnonzero(near.any(axis=0))
    if not len(at):
        return {}
    # Part of the way to the next dent.
    free = 0.4 * np.minimum(_free(places)[:, None], _free(there)[at])
    misfits = _misfits(seen, [entries[k] for k in at.tolist()], group, free)
    rows, columns = assigned(np.where(near[:, at], misfits, np.inf), 1.0)
    return dict(zip(rows.tolist(), at[columns].tolist(), strict=True))


def _misfits(
    seen: Sequence[ListedDent],
    entries: Sequence[ListedDent],
    group: int,
    free: NDArray[np.float64],
) -> NDArray[np.float64]:
    """How far dents lie from entries; 1 at the gate, infinite of those that are no pair.

    `free` is how far a dent whose sizes agree may lie within the group at most, metres.
    """
    dents, known = [each.dent for each in seen], [each.dent for each in entries]
    apart = np.stack([d.position for d in dents])[:, None] - [d.position for d in known]
    cut = np.array([d.is_cut for d in dents])[:, None] | np.array([d.is_cut for d in known])
    # Of a cut dent only a part is seen, with its centre anywhere in the dent.
    own = np.where(cut, _longest(seen, entries) / 2, 0.0)
    # Along the skin: the pose's error across it is not matched.
    normals = np.stack([dent.normal for dent in dents])[:, None]
    along = apart - (apart * normals).sum(axis=-1, keepdims=True) * normals
    widths, others = (np.array([d.width.value for d in each]) for each in (dents, known))
    width = np.nan_to_num(np.minimum(widths[:, None], others))
    # Frames that were put to each other over many others have drifted, metres.
    reach = np.where(np.isfinite(agreement(dents, known)), np.minimum(20e-3, free), 0.0)
    # Off a known dent within a frame that is matched, metres, and as a part of the width.
    gate = np.maximum(np.hypot(2e-3, 0.06 * width), reach)
    misfits = np.linalg.norm(along, axis=-1) / (gate + own)
    # In another group poses tell where they lie, which do for what is cut alone.
    elsewhere = np.array([each.group != group for each in entries])
    misfits[:, elsewhere] = np.inf
    i, j = np.nonzero(cut & elsewhere)
    ours, theirs = (np.stack([e.position_covariance for e in each]) for each in (seen, entries))
    spread = ours[i] + theirs[j] + np.square(own[i, j] / GATE)[:, None, None] * np.eye(3)
    misfits[i, j] = sigmas_apart(apart[i, j], spread) / GATE
    # Neither inward and outward, nor a step and what is none.
    depths, others = (np.array([d.depth.value for d in each]) for each in (dents, known))
    steps, others_are = (np.array([d.kind == 'step' for d in each]) for each in (dents, known))
    misfits[(depths[:, None] * others < 0) | (steps[:, None] != others_are)] = np.inf
    return misfits


def _longest(seen: Sequence[ListedDent], entries: Sequence[ListedDent]) -> NDArray[np.float64]:
    """The longer of each two lengths, metres; 0 where neither is known."""
    ours, theirs = (np.nan_to_num([e.dent.length.value for e in each]) for each in (seen, entries))
    return np.maximum(ours[:, None], theirs)


def _free(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each of some places to the next one, metres."""
    return cKDTree(places).query(places, k=2)[0][:, 1]


def _is_part(each: ListedDent, other: ListedDent) -> bool:
    """Whether an entry that no cloud shows whole lies in one that more clouds show whole.

    A cloud at the rim of which a dent lies may take it for two that overlap. Each cloud's dents
    are other dents in the list, so that the second of them would be one too.
    """
    dent = other.dent
    whole = sum(not sighting.dent.is_cut for sighting in other.sightings)
    if (
        not (other.group == each.group or _is_known(each, other))
        or whole <= len(each.sightings)
        or each.dent.kind == 'step'
        or dent.depth.value * each.dent.depth.value < 0
    ):
        return False
    away = each.dent.position - dent.position
    along, across = away @ dent.axis, away @ np.cross(dent.normal, dent.axis)
    # A step has no width, and nothing lies in it.
    return bool(np.hypot(2 * along / dent.length.value, 2 * across / dent.width.value) < 1)


def whole_steps(entries: Sequence[ListedDent]) -> list[ListedDent]:
    """Entries in which the pieces of a step, of which a cloud sees one each, are one."""
    pieces = [e for e in entries if e.dent.kind == 'step' and e.dent.is_cut]
    if not pieces:
        return list(entries)
    ties = np.array([[_are_one_step(each, other) for each in pieces] for other in pieces])
    _, numbers = connected_components(ties, directed=False)
    steps = [
        _joined([each for each, number in zip(pieces, numbers, strict=True) if number == step])
        for step in range(max(numbers) + 1)
    ]
    rest = [each for each in entries if each not in pieces]
    return sorted([*rest, *steps], key=lambda entry: entry.number)


def _are_one_step(each: ListedDent, other: ListedDent) -> bool:
    """Whether two pieces of steps are as high, and touch as far as it is known where they lie."""
    depth, height = each.dent.depth, other.dent.depth
    # As sizes of one dent agree: standard uncertainties, and a part of the size.
    spread = math.hypot(depth.uncertainty, height.uncertainty, 0.08 * height.value)
    apart = cKDTree(each.dent.closed_outline).query(other.dent.closed_outline)[0].min()
    known = np.linalg.eigvalsh(each.position_covariance + other.position_covariance)[-1]
    # Metres: as narrow as the least dent.
    reach = 0.01 if each.group == other.group else 0.01 - 2 * math.sqrt(known)
    return bool(abs(depth.value - height.value) < 4.0 * spread and apart < reach)


def _joined(pieces: Sequence[ListedDent]) -> ListedDent:
    """One step of its pieces, as long as they are together."""
    longest = max(pieces, key=lambda each: each.dent.length.value)
    dent, outline = longest.dent, np.concatenate([each.dent.closed_outline for each in pieces])
    outline = line_along(dent, outline)
    along = (outline - dent.position) @ dent.axis
    middle = outline[np.abs(along - (along[0] + along[-1]) / 2).argmin()]
    length = Estimate(float(along[-1] - along[0]), dent.length.uncertainty)
    return replace(
        pieces[0],
        dent=replace(dent, position=middle, outline=outline, length=length),
        sightings=tuple(seen for each in pieces for seen in each.sightings),
        best=longest.best,
    )


def _is_known(each: ListedDent, other: ListedDent) -> bool:
    """Whether poses tell where one entry lies to the other, as those of a survey do."""
    spread = each.position_covariance + other.position_covariance
    # Of a dent's width: better than that a place must be known to lie in it, where poses alone
    # tell.
    return bool(np.sqrt(np.linalg.eigvalsh(spread)[-1]) < 0.25 * other.dent.width.value)


def doubles(dents: Sequence[MeasuredDent], entries: Sequence[ListedDent]) -> list[tuple[int, ...]]:
    """Numbers of those that each entry may be, though neither dents nor poses are sure of it.

    Within a part of a flight dents tell each other apart, and what fits is one entry already.
    Between parts places are as uncertain as the poses: where sizes agree, and places too within
    that, there may be one dent for two numbers.

    Parameters
    ----------
    dents : sequence of MeasuredDent
        Of the entries, where the list has them.
    entries : sequence of ListedDent
    """
    groups = np.array([entry.group for entry in entries])
    if len(set(groups.tolist())) < 2:
        return [()] * len(entries)
    places = np.stack([dent.position for dent in dents])
    spreads = np.stack([entry.position_covariance for entry in entries])
    # What is cut has its centre anywhere in it.
    halves = np.array([np.nan_to_num(dent.length.value) / 2 * dent.is_cut for dent in dents])
    possible = (groups[:, None] != groups) & np.isfinite(agreement(dents, dents))
    result = []
    for index in range(len(entries)):
        others = np.flatnonzero(possible[index])
        apart = places[others] - places[index]
        cut = np.hypot(halves[others], halves[index]) / GATE
        spread = spreads[others] + spreads[index] + cut[:, None, None] ** 2 * np.eye(3)
        near = others[sigmas_apart(apart, spread) < GATE]
        result.append(tuple(sorted(entries[other].number for other in near)))
    return result
