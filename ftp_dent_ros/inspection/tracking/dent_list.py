"""The dents of several frames of one flight: a dent that is seen again is still one dent."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from ftp_dent_ros.inspection.clearance import with_clearances
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.observation import SAME
from ftp_dent_ros.inspection.tracking.constellation import about, agreement, find_match, move_about
from ftp_dent_ros.inspection.tracking.sightings import ListedDent, Sighting, listed
from ftp_dent_ros.pose import Pose

# Standard uncertainty of a pose whose covariance is not known (all zeros, in ROS): metres,
# radians.
UNKNOWN_POSITION, UNKNOWN_ANGLE = 0.02, 0.01
# Of a pose that nothing is uncertain about: a cloud in its own frame.
EXACT = np.eye(6) * 1e-12
# What no pose is better than: 1 mm, 0.5 mrad.
_NEVER_BETTER = np.diag([1e-3**2] * 3 + [5e-4**2] * 3)
# Part of a pose's error that the frame before had too: estimators drift, they do not jump.
_SHARED = 0.8
# Chi of three axes that holds 99.7 %.
_GATE = 3.75
# Off a known dent within a frame that is matched, metres, and as a part of the width.
_PLACE, _OF_WIDTH = 2e-3, 0.06
# Or farther, where its sizes agree, but no farther than this part of the way to the next dent:
# frames that were put to each other over many others have drifted, metres.
_FREE, _FARTHEST = 0.4, 20e-3

Indices = list[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class _Entry:
    """One dent, and the group of dents among which its place is known exactly."""

    group: int
    listed: ListedDent

    @property
    def dent(self) -> MeasuredDent:
        return self.listed.dent

    def with_sightings(self, *more: Sighting) -> _Entry:
        sightings = sorted((*self.listed.sightings, *more), key=lambda item: item.frame)
        return replace(self, listed=listed(self.listed.number, tuple(sightings)))

    def moved(self, move: Pose, group: int) -> _Entry:
        sightings = tuple(
            replace(item, dent=item.dent.transformed(move)) for item in self.listed.sightings
        )
        return _Entry(group, listed(self.listed.number, sightings))


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

    Parameters
    ----------
    first : int
        Number of the first dent.
    """

    def __init__(self, first: int = 1) -> None:
        self._entries: list[_Entry] = []
        self._frames: set[tuple[str, int]] = set()
        self._numbers, self._groups = first - 1, 0
        self._error: NDArray[np.float64] | None = None
        self._placed: list[_Placed] = []

    @property
    def entries(self) -> tuple[ListedDent, ...]:
        """All that was found, with the clearances of this list."""
        known = sorted(self._entries, key=lambda entry: entry.listed.number)
        shifts = {entry.group: self._shift(entry.group) for entry in known}
        dents = with_clearances([_shifted(e.dent, shifts[e.group]) for e in known])
        return tuple(
            replace(each.listed, dent=dent) for each, dent in zip(known, dents, strict=True)
        )

    def _shift(self, group: int) -> NDArray[np.float64]:
        """From where a group lies to where its poses have it in the mean."""
        off = [each.stated - each.found for each in self._placed if each.group == group]
        return np.mean(off, axis=0) if off else np.zeros(3)

    def clear(self) -> None:
        """Forget all."""
        self.__init__()  # type: ignore[misc]

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
        pivot = np.zeros(3) if pose is None else pose.translation
        doubt = _known(covariance)
        expected = self._expected(pivot)
        matches = self._matches(dents, pivot, doubt, expected)
        move = matches[0][1] if matches else expected
        self._error = _error_of(move, pivot)
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
        pairs = _paired([item.dent for item in seen], seen, self._entries, group)
        for index, at in pairs:
            self._entries[at] = self._entries[at].with_sightings(seen[index])
        for index in sorted(set(range(len(seen))) - {index for index, _ in pairs}):
            self._numbers += 1
            self._entries.append(_Entry(group, listed(self._numbers, (seen[index],))))

    def _expected(self, pivot: NDArray[np.float64]) -> Pose:
        """Where a frame lies if its pose errs as the one before did."""
        if self._error is None or not self._error.any():
            return SAME
        return move_about(_SHARED * self._error, pivot)

    def _matches(
        self,
        dents: Sequence[MeasuredDent],
        pivot: NDArray[np.float64],
        doubt: NDArray[np.float64],
        expected: Pose,
    ) -> list[tuple[int, Pose]]:
        """Groups that the frame shows, and the move onto each, the surest first."""
        found = []
        # This pose errs nearly as the one before; or both err, each by itself.
        ways = [(expected, (1 - _SHARED**2) * doubt)] if self._error is not None else []
        ways.append((SAME, 2 * doubt))
        for group in sorted({entry.group for entry in self._entries}):
            known = [entry.dent for entry in self._entries if entry.group == group]
            for start, spread in ways:
                moved = dents if start is SAME else [dent.transformed(start) for dent in dents]
                match = find_match(moved, known, pivot, spread)
                if match is not None:
                    found.append((match.odds, group, match.move @ start))
        best = {group: max(o for o, g, _ in found if g == group) for _, group, _ in found}
        found = [each for each in found if each[0] == best[each[1]]]
        found.sort(key=lambda each: -each[0])
        return [(group, move) for _, group, move in found]

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
            pairs = dict(_paired([e.dent for e in moved], sightings, self._entries, group))
            for index, each in enumerate(moved):
                at = pairs.get(index)
                if at is None:
                    self._entries.append(each)
                else:
                    together = self._entries[at].with_sightings(*each.listed.sightings)
                    self._entries[at] = together
        return group


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


def _paired(
    dents: Sequence[MeasuredDent],
    sightings: Sequence[Sighting],
    entries: Sequence[_Entry],
    group: int,
) -> Indices:
    """Which dents, in their places, are which entries: one of the other at most."""
    cost = np.full((len(dents), len(entries)), np.inf)
    if not cost.size:
        return []
    known = [entry.dent for entry in entries]
    free = _free(dents)[:, None], _free(known)
    reach = np.minimum(_FARTHEST, _FREE * np.minimum(*free))
    reach = np.where(np.isfinite(agreement(dents, known)), reach, 0.0)
    for row, (dent, sighting) in enumerate(zip(dents, sightings, strict=True)):
        for column, entry in enumerate(entries):
            near = reach[row, column] if entry.group == group else None
            cost[row, column] = _misfit(dent, sighting, entry, near)
    rows, columns = linear_sum_assignment(np.minimum(cost, 1.0))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1.0]


def _free(dents: Sequence[MeasuredDent]) -> NDArray[np.float64]:
    """Distance of each dent's centre to the next one's, metres."""
    places = np.stack([dent.position for dent in dents])
    apart = cdist(places, places)
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1)


def _misfit(dent: MeasuredDent, sighting: Sighting, entry: _Entry, reach: float | None) -> float:
    """How far a dent lies from an entry; 1 at the gate.

    `reach` is how far it may lie within a group, metres, and None where it is in another.
    """
    other = entry.dent
    if dent.depth.value * other.depth.value < 0 or (dent.kind == 'step') != (other.kind == 'step'):
        return np.inf
    sizes = [d.length.value for d in (dent, other) if np.isfinite(d.length.value)] or [0.0]
    partly = dent.is_cut or other.is_cut
    # Of a cut dent only a part is seen, with its centre anywhere in the dent.
    own = max(sizes) / 2 if partly else 0.0
    apart = dent.position - other.position
    if reach is not None:
        # Along the skin: the pose's error across it is not matched.
        apart = apart - dent.normal * (apart @ dent.normal)
        width = np.nan_to_num(min(dent.width.value, other.width.value))
        gate = max(float(np.hypot(_PLACE, _OF_WIDTH * width)), reach)
        return float(np.linalg.norm(apart)) / (gate + own)
    if not partly:
        return np.inf
    spread = entry.listed.position_covariance + sighting.position_covariance
    spread = spread + np.eye(3) * (own / _GATE) ** 2
    return float(np.sqrt(apart @ np.linalg.solve(spread, apart)) / _GATE)


def _shifted(dent: MeasuredDent, shift: NDArray[np.float64]) -> MeasuredDent:
    return replace(dent, position=dent.position + shift, outline=dent.outline + shift)


def _known(covariance: NDArray[np.float64] | None) -> NDArray[np.float64]:
    if covariance is None or not np.any(covariance):
        return np.diag([UNKNOWN_POSITION**2] * 3 + [UNKNOWN_ANGLE**2] * 3)
    return np.asarray(covariance, float).reshape(6, 6) + _NEVER_BETTER


def _error_of(move: Pose, pivot: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shift of the pivot, and turn about it, of a move: shape (6,)."""
    return np.concatenate([move.apply(pivot) - pivot, move.rotation.as_rotvec()])
