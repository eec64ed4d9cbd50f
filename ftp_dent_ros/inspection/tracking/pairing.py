"""Which dents of a frame, in their places, are which of those that are listed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.tracking.agreement import agreement
from ftp_dent_ros.inspection.tracking.sightings import ListedDent, Sighting, listed
from ftp_dent_ros.pose import Pose

# Chi of three axes that holds 99.7 %.
GATE = 3.75
# Off a known dent within a frame that is matched, metres, and as a part of the width.
_PLACE, _OF_WIDTH = 2e-3, 0.06
# Or farther, where its sizes agree, but no farther than this part of the way to the next dent:
# frames that were put to each other over many others have drifted, metres.
_FREE, _FARTHEST = 0.4, 20e-3
# Farther from each other than this no pose puts one dent, and its length; metres.
_ELSEWHERE = 1.0

Indices = list[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Entry:
    """One dent, and the group of dents among which its place is known exactly."""

    group: int
    listed: ListedDent

    @property
    def dent(self) -> MeasuredDent:
        """The dent as it is listed, from all its sightings."""
        return self.listed.dent

    def with_sightings(self, *more: Sighting) -> Entry:
        """The same dent, seen more often."""
        sightings = sorted((*self.listed.sightings, *more), key=lambda item: item.frame)
        return replace(self, listed=listed(self.listed.number, tuple(sightings)))

    def moved(self, move: Pose, group: int) -> Entry:
        """The same dent in its place in another group."""
        sightings = tuple(
            replace(item, dent=item.dent.transformed(move)) for item in self.listed.sightings
        )
        return Entry(group, listed(self.listed.number, sightings))


def paired(
    dents: Sequence[MeasuredDent],
    sightings: Sequence[Sighting],
    entries: Sequence[Entry],
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
    thinkable = _thinkable(dents, known)
    for row, (dent, sighting) in enumerate(zip(dents, sightings, strict=True)):
        for column in np.flatnonzero(thinkable[row]).tolist():
            entry = entries[column]
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


def _thinkable(dents: Sequence[MeasuredDent], known: Sequence[MeasuredDent]) -> NDArray[np.bool_]:
    """Mask of the pairs that are no farther apart than any pose errs and any dent is long."""
    places, there = (np.stack([dent.position for dent in each]) for each in (dents, known))
    sizes, others = (
        np.nan_to_num([dent.length.value for dent in each]) for each in (dents, known)
    )
    return cdist(places, there) < _ELSEWHERE + np.maximum(sizes[:, None], others)


def _misfit(dent: MeasuredDent, sighting: Sighting, entry: Entry, reach: float | None) -> float:
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
    spread = spread + np.eye(3) * (own / GATE) ** 2
    return float(np.sqrt(apart @ np.linalg.solve(spread, apart)) / GATE)
