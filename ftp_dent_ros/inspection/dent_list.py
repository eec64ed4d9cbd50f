"""The dents of several frames of one flight: a dent that is seen again is still one dent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent
from ftp_dent_ros.pose import Pose

# Standard uncertainty of a position whose covariance is not known (all zeros, in ROS), metres.
UNKNOWN_POSITION = 0.02
# Of a pose that nothing is uncertain about: a cloud in its own frame.
EXACT = np.eye(6) * 1e-12
# Two sightings of one dent lie within this many standard uncertainties (chi, 3 axes, 99.7 %).
_GATE = 3.75
_ESTIMATES = ('depth', 'length', 'width', 'model_length', 'model_width', 'area', 'volume')
_NONE = np.zeros((0, 3))
_NO_PROFILE = np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Sighting:
    """A dent as one frame gave it.

    Attributes
    ----------
    frame : int
        Number of the frame.
    dent : MeasuredDent
        In the list's frame of reference.
    position_covariance : ndarray, shape (3, 3)
        Of its position in that frame, square metres: what the pose leaves open.
    repeats : tuple of MeasuredDent
        The same dent measured on parts of the same cloud.
    """

    frame: int
    dent: MeasuredDent
    position_covariance: NDArray[np.float64]
    repeats: tuple[MeasuredDent, ...] = ()


@dataclass(frozen=True, eq=False)
class ListedDent:
    """One dent with all its sightings.

    Attributes
    ----------
    number : int
        From 1, in the order of the first sightings.
    dent : MeasuredDent
        Measurements of all sightings in which the dent is whole, combined; outline and profiles
        are those of `best`.
    position_covariance : ndarray, shape (3, 3)
        Square metres.
    sightings : tuple of Sighting
        In the order of the frames.
    best : int
        Number of the frame that shows it best.
    """

    number: int
    dent: MeasuredDent
    position_covariance: NDArray[np.float64]
    sightings: tuple[Sighting, ...]
    best: int


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
            self._entries.append(_entry(self._numbers, (seen[column],)))
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


def combined(estimates: Sequence[Estimate]) -> Estimate:
    """Weighted mean of measurements of one quantity.

    Its uncertainty is the one that the measurements claim (internal) or the one that their
    scatter shows (external), whichever is larger (Birge, Phys. Rev. 40, 207, 1932).
    """
    values = np.array([item.value for item in estimates])
    sigma = np.array([item.uncertainty for item in estimates])
    known = np.isfinite(values)
    if not known.any():
        return Estimate(float('nan'), float('nan'))
    values, sigma = values[known], sigma[known]
    if not (np.isfinite(sigma) & (sigma > 0)).all():
        spread = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else float('nan')
        return Estimate(float(values.mean()), float(spread))
    weights = sigma**-2.0
    mean = float(np.average(values, weights=weights))
    internal = weights.sum() ** -0.5
    external = 0.0
    if len(values) > 1:
        external = np.sqrt(np.average((values - mean) ** 2, weights=weights) / (len(values) - 1))
    return Estimate(mean, float(max(internal, external)))


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
    return _entry(entry.number, (*entry.sightings, item))


def _entry(number: int, sightings: tuple[Sighting, ...]) -> ListedDent:
    whole = [item for item in sightings if not item.dent.is_cut]
    if whole:
        best = min(whole, key=lambda item: _rank(item.dent.depth.uncertainty))
    else:
        best = max(sightings, key=lambda item: _rank(item.dent.length.value, -1.0))
    used = whole or [best]
    dents = [item.dent for item in used]
    spreads = np.stack([item.position_covariance for item in used]) + np.eye(3) * 1e-12
    weights = np.linalg.inv(spreads)
    places = np.stack([dent.position for dent in dents])
    # The poses of one flight share most of their error: it does not average out.
    covariance = np.linalg.inv(weights.mean(axis=0))
    position = covariance @ np.einsum('nij,nj->i', weights, places) / len(used)
    values: dict[str, Any] = {
        name: combined([getattr(d, name) for d in dents]) for name in _ESTIMATES
    }
    axis = _mean_direction([d.axis for d in dents], best.dent.axis)
    # Angles of an axis repeat after half a turn.
    turns = [(d.orientation.value - best.dent.orientation.value) for d in dents]
    near = [(t + np.pi / 2) % np.pi - np.pi / 2 for t in turns]
    turn = combined(
        [Estimate(t, d.orientation.uncertainty) for t, d in zip(near, dents, strict=True)]
    )
    angle = (best.dent.orientation.value + turn.value + np.pi / 2) % np.pi - np.pi / 2
    dent = replace(
        best.dent,
        position=position,
        normal=_mean_direction([d.normal for d in dents], best.dent.normal),
        axis=axis,
        orientation=Estimate(float(angle), turn.uncertainty),
        significance=max(d.significance for d in dents),
        outline=best.dent.outline + (position - best.dent.position),
        **values,
    )
    kept = tuple(item if item is best else _without_curves(item) for item in sightings)
    return ListedDent(number, dent, covariance, kept, best.frame)


def _rank(value: float, unknown: float = float('inf')) -> float:
    return value if np.isfinite(value) else unknown


def _mean_direction(vectors: list[NDArray], like: NDArray) -> NDArray[np.float64]:
    total = sum(np.sign(vector @ like) * vector for vector in vectors)
    return total / np.linalg.norm(total)


def _without_curves(item: Sighting) -> Sighting:
    """A long flight has many sightings, and only the best one's curves are shown."""
    curves: dict[str, Any] = {
        'outline': _NONE,
        'length_profile': _NO_PROFILE,
        'width_profile': _NO_PROFILE,
    }
    return replace(item, dent=replace(item.dent, **curves))
