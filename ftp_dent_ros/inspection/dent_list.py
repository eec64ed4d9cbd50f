"""The dents of several frames of one flight: a dent that is seen again is still one dent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from ftp_dent_ros.inspection.combining import ListedDent, Sighting, listed
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.pose import Pose

# Standard uncertainty of a position whose covariance is not known (all zeros, in ROS), metres.
UNKNOWN_POSITION = 0.02
# Of a pose that nothing is uncertain about: a cloud in its own frame.
EXACT = np.eye(6) * 1e-12
# Two sightings of one dent lie within this many standard uncertainties (chi, 3 axes, 99.7 %).
_GATE = 3.75


class DentList:
    """Dents over the frames of a flight, in one frame of reference (``map``).

    Parameters
    ----------
    first : int
        Number of the first dent.
    """

    def __init__(self, first: int = 1) -> None:
        self._entries: list[ListedDent] = []
        self._numbers = first - 1

    @property
    def entries(self) -> tuple[ListedDent, ...]:
        """Every dent, bump and step, with the clearances of this list."""
        return with_clearances(self._entries)

    def clear(self) -> None:
        """Forget all."""
        self._entries.clear()
        self._numbers = 0

    def add(
        self,
        frame: int,
        dents: Sequence[MeasuredDent],
        pose: Pose | None = None,
        covariance: NDArray[np.float64] | None = None,
        repeats: Sequence[tuple[MeasuredDent, ...]] = (),
    ) -> None:
        """Add what one frame shows.

        Parameters
        ----------
        frame : int
            Number of the frame; each is added once.
        dents : sequence of MeasuredDent
            In the list's frame of reference.
        pose : Pose, optional
            The vehicle's pose in it at that frame, about whose origin `covariance` turns.
        covariance : ndarray, shape (6, 6), optional
            Of the pose, as in geometry_msgs/PoseWithCovariance (x, y, z, and rotations about
            the fixed axes); none or all zeros is unknown, and then `UNKNOWN_POSITION` is taken.
        repeats : sequence of tuple of MeasuredDent, optional
            For each dent its measurements on parts of the cloud.
        """
        repeats = repeats or [()] * len(dents)
        seen = [
            Sighting(frame, dent, position_covariance(dent.position, pose, covariance), again)
            for dent, again in zip(dents, repeats, strict=True)
        ]
        known = len(self._entries)
        cost = np.array([[_misfit(entry, item) for item in seen] for entry in self._entries])
        new = set(range(len(seen)))
        if cost.size:
            # Beyond the gate all are equally bad, so that they decide nothing.
            for row, column in zip(*linear_sum_assignment(np.minimum(cost, 1.0)), strict=True):
                if cost[row, column] < 1.0:
                    self._entries[row] = _with(self._entries[row], seen[column])
                    new.discard(column)
        for column in sorted(new):
            self._numbers += 1
            self._entries.append(listed(self._numbers, (seen[column],)))
        assert len(self._entries) == known + len(new)


def position_covariance(
    position: NDArray[np.float64],
    pose: Pose | None = None,
    covariance: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Covariance of a point that a pose places, shape (3, 3), square metres."""
    if covariance is None or not np.any(covariance):
        return np.eye(3) * UNKNOWN_POSITION**2
    x, y, z = position - (0.0 if pose is None else pose.translation)
    turned = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    jacobian = np.hstack([np.eye(3), turned])
    return jacobian @ np.asarray(covariance, float).reshape(6, 6) @ jacobian.T


def with_clearances(entries: Sequence[ListedDent]) -> tuple[ListedDent, ...]:
    """The same dents, each with the distance from its outline to the next dent's."""
    dents = [entry for entry in entries if entry.dent.kind == 'dent']
    trees = {entry.number: cKDTree(_outline(entry.dent)) for entry in dents}
    result = []
    for entry in entries:
        others = [tree for number, tree in trees.items() if number != entry.number]
        points = _outline(entry.dent)
        nearest = min(
            (float(tree.query(points)[0].min()) for tree in others), default=float('inf')
        )
        result.append(replace(entry, dent=replace(entry.dent, clearance=nearest)))
    return tuple(result)


def _outline(dent: MeasuredDent) -> NDArray[np.float64]:
    return dent.outline if len(dent.outline) else dent.position[None]


def _misfit(entry: ListedDent, item: Sighting) -> float:
    """How far a sighting lies from a dent of the list; 1 at the gate."""
    a, b = entry.dent, item.dent
    if a.kind != b.kind:
        return float('inf')
    sizes = [d.length.value for d in (a, b) if np.isfinite(d.length.value)] or [0.0]
    # Of a cut dent only a part is seen, with its centre anywhere in the dent.
    own = max(sizes) / 2 if a.is_cut or b.is_cut else min(sizes) / 6
    spread = entry.position_covariance + item.position_covariance
    spread = spread + np.eye(3) * (own / _GATE) ** 2
    apart = a.position - b.position
    return float(np.sqrt(apart @ np.linalg.solve(spread, apart)) / _GATE)


def _with(entry: ListedDent, item: Sighting) -> ListedDent:
    return listed(entry.number, (*entry.sightings, item))
