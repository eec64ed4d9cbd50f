"""The dents of several frames of one flight: a dent that is seen again is still one dent."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.clearance import with_clearances
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.observation import SAME
from ftp_dent_ros.inspection.tracking.doubles import doubles
from ftp_dent_ros.inspection.tracking.given import Given
from ftp_dent_ros.inspection.tracking.glass import Glass, Seen, Spot
from ftp_dent_ros.inspection.tracking.groups import expected_move, groups_shown
from ftp_dent_ros.inspection.tracking.pairing import Entry, paired
from ftp_dent_ros.inspection.tracking.parts import without_parts
from ftp_dent_ros.inspection.tracking.pose_errors import (
    error_of,
    known_covariance,
    position_covariance,
)
from ftp_dent_ros.inspection.tracking.sightings import ListedDent, Sighting, listed
from ftp_dent_ros.pose import Pose


@dataclass(frozen=True, eq=False)
class _Placed:
    """The middle of a frame's dents: where its pose has it, and where it was found to lie."""

    group: int
    stated: NDArray[np.float64]
    found: NDArray[np.float64]


class DentList:
    """Dents over the frames of a flight, in one frame of reference (``map``).

    A frame lies where its dents lie on those of a group, and the group where its frames' poses
    have it in the mean. Frames that show no known dent begin another group, until one joins both.
    What keeps its place in the picture while the camera moves is of a glass, and not in the list.

    Parameters
    ----------
    first : int
        Number of the first dent.
    """

    def __init__(self, first: int = 1) -> None:
        self._entries: list[Entry] = []
        self._frames: set[tuple[str, int]] = set()
        self._numbers, self._groups = first - 1, 0
        self._begun: dict[tuple[int, int], int] = {}
        self._error: NDArray[np.float64] | None = None
        self._placed: list[_Placed] = []
        self._glass, self._of_glass = Glass(), frozenset[Seen]()
        self._given: list[Given] = []
        self._base = SAME

    @property
    def entries(self) -> tuple[ListedDent, ...]:
        """All that was found on the skin, with the clearances of this list."""
        known = sorted(without_parts(self._entries), key=lambda entry: entry.listed.number)
        shifts = {entry.group: self._shift(entry.group) for entry in known}
        dents = with_clearances([_shifted(e.dent, shifts[e.group]) for e in known])
        return tuple(
            replace(each.listed, dent=dent, maybe=maybe)
            for each, dent, maybe in zip(known, dents, doubles(dents, known), strict=True)
        )

    @property
    def glass(self) -> tuple[Spot, ...]:
        """Marks on a glass of the camera or the projector, which are not in the list."""
        return self._glass.marks

    def _shift(self, group: int) -> NDArray[np.float64]:
        """From where a group lies to where its poses have it in the mean."""
        off = [each.stated - each.found for each in self._placed if each.group == group]
        return np.mean(off, axis=0) if off else np.zeros(3)

    def copy(self) -> DentList:
        """The same list, to go on from another time."""
        other = DentList()
        other.__dict__.update({name: copy(value) for name, value in self.__dict__.items()})
        return other

    def moved(self, move: Pose) -> DentList:
        """The same list, moved as one."""
        other = self.copy()
        if move is SAME:
            return other
        other._entries = [each.moved(move, each.group) for each in self._entries]
        other._placed = [
            _Placed(each.group, move.apply(each.stated), move.apply(each.found))
            for each in self._placed
        ]
        other._glass, other._base = self._glass.moved(move), move @ self._base
        if self._error is not None:
            turned = move.rotation.apply(self._error.reshape(2, 3))
            other._error = turned.ravel()
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
        repeats: Sequence[tuple[MeasuredDent, ...]] = (),
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
        repeats : sequence of tuple of MeasuredDent, optional
            For each dent its measurements on parts of the cloud.
        stamp_ns : int, optional
            Of the exposure: the same one is the same frame, whatever its number.
        """
        key = ('frame', frame) if stamp_ns is None else ('stamp', stamp_ns)
        if key in self._frames:
            return False
        before = {name: copy(value) for name, value in self.__dict__.items()}
        try:
            self._add(frame, dents, pose, covariance, repeats or [()] * len(dents))
        except BaseException:
            # What cannot be added changes nothing.
            self.__dict__.update(before)
            raise
        self._frames.add(key)
        return True

    def _add(
        self,
        frame: int,
        dents: Sequence[MeasuredDent],
        pose: Pose | None,
        covariance: NDArray[np.float64] | None,
        repeats: Sequence[tuple[MeasuredDent, ...]],
    ) -> None:
        if pose is not None:
            stated = known_covariance(covariance)
            self._glass = self._glass.with_frame(frame, dents, pose, stated)
        given = Given(frame, dents, pose, covariance, repeats, self._base)
        self._given.append(given)
        before, self._of_glass = self._of_glass, self._glass.of_marks
        if {each for each in self._of_glass if each[0] != frame} == before:
            self._place(given)
            return
        # What is of a glass has had a say in where frames lie: once more without it.
        self._entries, self._placed, self._groups, self._error = [], [], 0, None
        for each in self._given:
            self._place(each.moved(self._base))

    def _place(self, given: Given) -> None:
        """Put a frame in its place, and pair what it shows of the skin with what is known."""
        frame, pose, covariance = given.frame, given.pose, given.covariance
        kept = [i for i in range(len(given.dents)) if (frame, i) not in self._of_glass]
        dents = [given.dents[index] for index in kept]
        repeats = [given.repeats[index] for index in kept]
        pivot = np.zeros(3) if pose is None else pose.translation
        doubt = known_covariance(covariance)
        expected = expected_move(self._error, pivot)
        known: dict[int, list[MeasuredDent]] = {}
        for entry in self._entries:
            known.setdefault(entry.group, []).append(entry.dent)
        matches = groups_shown(dents, known, pivot, doubt, expected)
        move = matches[0][1] if matches else SAME if expected is None else expected
        self._error = error_of(move, pivot)
        seen = [
            Sighting(
                frame,
                dent if move is SAME else dent.transformed(move),
                position_covariance(dent.position, pose, covariance),
                tuple(again),
            )
            for dent, again in zip(dents, repeats, strict=True)
        ]
        group = self._joined(matches)
        if len(dents):
            stated = np.mean([dent.position for dent in dents], axis=0)
            self._placed.append(_Placed(group, stated, move.apply(stated)))
        pairs = paired([item.dent for item in seen], seen, self._entries, group)
        for index, at in pairs:
            self._entries[at] = self._entries[at].with_sightings(seen[index])
        for index in sorted(set(range(len(seen))) - {index for index, _ in pairs}):
            self._entries.append(
                Entry(group, listed(self._number(frame, kept[index]), (seen[index],)))
            )

    def _number(self, frame: int, index: int) -> int:
        """Number of the dent that a frame's dent begins."""
        if (frame, index) not in self._begun:
            self._numbers += 1
            self._begun[frame, index] = self._numbers
        return self._begun[frame, index]

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
                _Placed(group, each.stated, onto.apply(each.found))
                if each.group == other
                else each
                for each in self._placed
            ]
            sightings = [each.listed.sightings[0] for each in moved]
            pairs = dict(paired([e.dent for e in moved], sightings, self._entries, group))
            for index, each in enumerate(moved):
                at = pairs.get(index)
                if at is None:
                    self._entries.append(each)
                else:
                    together = self._entries[at].with_sightings(*each.listed.sightings)
                    self._entries[at] = together
        return group


def _shifted(dent: MeasuredDent, shift: NDArray[np.float64]) -> MeasuredDent:
    return replace(dent, position=dent.position + shift, outline=dent.outline + shift)
