"""Sightings of one dent, combined."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ftp_dent_ros.dents.dent import Estimate, MeasuredDent
from ftp_dent_ros.pose import Pose

_ESTIMATES = ('depth', 'length', 'width', 'model_length', 'model_width', 'area', 'volume')

#: Standard deviation of a narrow dent's centre among its neighbours, metres.
CENTRE = 4e-4
# Natural logarithm of the range over which other dents' sizes lie, at most: hail's, which is the
# most alike (depths of 1 to 4, lengths of 1 to 2.5). Widths tell little that lengths do not.
_RANGES = {'depth': 1.4, 'length': 0.9}

Field = NDArray[np.float64]


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
    """

    frame: int
    dent: MeasuredDent
    position_covariance: NDArray[np.float64]


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
    maybe : tuple of int
        Numbers of dents of other parts of the flight that may be the same one.
    group : int
        Of dents among which its place is known exactly.
    """

    number: int
    dent: MeasuredDent
    position_covariance: NDArray[np.float64]
    sightings: tuple[Sighting, ...]
    best: int
    maybe: tuple[int, ...] = ()
    group: int = 0

    def with_sightings(self, more: Sequence[Sighting]) -> ListedDent:
        """The same dent, seen more often."""
        sightings = sorted((*self.sightings, *more), key=lambda item: item.frame)
        return listed(self.number, tuple(sightings), self.group)

    def moved(self, move: Pose, group: int) -> ListedDent:
        """The same dent in its place in another group."""
        sightings = tuple(
            replace(item, dent=item.dent.transformed(move)) for item in self.sightings
        )
        return listed(self.number, sightings, group)

    @property
    def reason(self) -> str:
        """What is in doubt of the dent, and whether it may have two numbers."""
        twice = (
            f'may be the same as number {" or ".join(map(str, self.maybe))}: only the poses tell '
            'how these parts of the flight lie to each other'
        )
        return '; '.join(filter(None, (self.dent.reason, twice if self.maybe else '')))


def listed(number: int, sightings: tuple[Sighting, ...], group: int = 0) -> ListedDent:
    """One dent from all its sightings; of cut ones only if it is nowhere whole."""
    whole = [item for item in sightings if not item.dent.is_cut]
    if whole:
        best = min(whole, key=lambda item: np.nan_to_num(item.dent.depth.uncertainty, nan=np.inf))
    else:
        # What most take it for: one that runs into something else may be the longest.
        often = Counter(item.dent.kind for item in sightings)
        usual = [item for item in sightings if often[item.dent.kind] == max(often.values())]
        best = max(usual, key=lambda item: np.nan_to_num(item.dent.length.value, nan=-1.0))
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
    outline = best.dent.outline + (position - best.dent.position)
    if best.dent.kind == 'step' and not whole:
        # Each shows another piece of it.
        pieces = np.concatenate([item.dent.outline for item in sightings])
        outline = line_along(best.dent, pieces)
    dent = replace(
        best.dent,
        position=position,
        normal=_mean_direction([d.normal for d in dents], best.dent.normal),
        axis=axis,
        orientation=Estimate(float(angle), turn.uncertainty),
        significance=max(d.significance for d in dents),
        outline=outline,
        **values,
    )
    kept = tuple(item if item is best else _without_curves(item) for item in sightings)
    return ListedDent(number, dent, covariance, kept, best.frame, group=group)


def combined(estimates: Sequence[Estimate]) -> Estimate:
    """Weighted mean of measurements of one quantity.

    What their scatter shows averages out. What they claim beyond it they may have in common (the
    dent's form, what windows take of it, the rig): that does not.
    """
    values = np.array([item.value for item in estimates])
    sigma = np.array([item.uncertainty for item in estimates])
    known = np.isfinite(values)
    if not known.any():
        return Estimate(float('nan'), float('nan'))
    values, sigma = values[known], sigma[known]
    # What states no uncertainty weighs as much as others that state none.
    weights = np.maximum(sigma, 1e-15) ** -2.0
    mean = float(np.average(values, weights=weights))
    stated, scatter = 1 / weights.mean(), 0.0
    if len(values) > 1:
        scatter = np.average((values - mean) ** 2, weights=weights) * len(values)
        scatter /= len(values) - 1
    return Estimate(mean, math.sqrt(scatter / len(values) + max(stated - scatter, 0.0)))


def _mean_direction(vectors: list[NDArray], like: NDArray) -> NDArray[np.float64]:
    total = sum(np.sign(vector @ like) * vector for vector in vectors)
    return total / np.linalg.norm(total)


def _without_curves(item: Sighting) -> Sighting:
    """A long flight has many sightings, and only the best one's curves are shown.

    Of a step all that was seen is its outline.
    """
    none = np.zeros((0, 2))
    is_step = item.dent.kind == 'step'
    outline = line_along(item.dent, item.dent.outline) if is_step else np.zeros((0, 3))
    bare = replace(item.dent, outline=outline, length_profile=none, width_profile=none)
    return replace(item, dent=bare)


def line_along(step: MeasuredDent, outline: Field) -> Field:
    """Points of an outline in their order along a step, one each 5 mm, shape (n, 3)."""
    along = (outline - step.position) @ step.axis
    return outline[np.unique(np.floor(along / 0.005), return_index=True)[1]]


def agreement(seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]) -> Field:
    """Chi-square of the sizes' differences; infinite where they cannot be the same."""
    # A step is no other's like.
    ours, theirs = (
        np.array([math.nan if d.kind == 'step' else np.sign(d.depth.value) for d in each])
        for each in (seen, known)
    )
    result = np.where(ours[:, None] == theirs, 0.0, np.inf)
    for name in ('depth', 'length', 'width'):
        difference, spread, _ = _compared(name, seen, known)
        off = difference / spread
        # Sizes agree within so many standard uncertainties.
        result += np.where(off < 4.0, off**2, np.inf)
    return result


def centre_deviations(seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]) -> Field:
    """Standard deviation of a dent's centre among its neighbours, metres; shape (seen, known)."""
    widths = [np.nan_to_num([dent.width.value for dent in each]) for each in (seen, known)]
    return np.hypot(CENTRE, 0.015 * np.minimum(widths[0][:, None], widths[1]))


def assigned(cost: Field, most: float = 1e6) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of pairs, one of each at most, that cost the least together.

    A pair that costs `most` or more is none.
    """
    rows, columns = linear_sum_assignment(np.minimum(cost, most))
    paired = cost[rows, columns] < most
    return rows[paired], columns[paired]


def sigmas_apart(apart: Field, covariance: Field) -> Field:
    """Lengths of vectors, shape (..., 3), in standard deviations of them, (..., 3, 3)."""
    whitened = np.linalg.solve(covariance, apart[..., None])[..., 0]
    return np.sqrt((apart * whitened).sum(axis=-1))


def coincidence(
    seen: Sequence[MeasuredDent],
    known: Sequence[MeasuredDent],
    among: Sequence[MeasuredDent],
) -> Field:
    """How rarely sizes of two different dents would lie as near to each other as two of one.

    Natural logarithm, shape (seen, known); 0 where nothing is known of the sizes, and where those
    of `among`, of which the known ones are some, are all alike. With half of `agreement` taken
    off, it is that of the likelihood ratio of one dent against two.
    """
    result = np.zeros((len(seen), len(known)))
    for name, widest in _RANGES.items():
        _, spread, size = _compared(name, seen, known)
        extent = min(widest, _range(name, among))
        result += np.log(np.fmax(extent * size / (math.sqrt(2 * math.pi) * spread), 1.0))
    return result


def _range(name: str, known: Sequence[MeasuredDent]) -> float:
    """Natural logarithm of the range of a size, as if all in it were alike frequent."""
    sizes = np.abs([getattr(each, name).value for each in known if not each.is_cut])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    # Known dents from which on they tell themselves how alike they are.
    return math.inf if len(sizes) < 4 else math.sqrt(12) * float(np.log(sizes).std(ddof=1))


def _compared(
    name: str, seen: Sequence[MeasuredDent], known: Sequence[MeasuredDent]
) -> tuple[Field, Field, Field]:
    """Difference of a size, its standard deviation, and the smaller of the two sizes, metres.

    Difference and size are 0 where it is not known, or the frame cuts the dent.
    """
    one, other = ([getattr(d, name) for d in each] for each in (seen, known))
    values = np.array([e.value for e in one])[:, None], np.array([e.value for e in other])
    sigma = [np.nan_to_num([e.uncertainty for e in each]) for each in (one, other)]
    size = np.minimum(np.abs(values[0]), np.abs(values[1]))
    # A part of the size is added.
    spread = np.hypot(np.hypot(sigma[0][:, None], sigma[1]), 0.08 * np.nan_to_num(size))
    cut = np.array([d.is_cut for d in seen])[:, None] | np.array([d.is_cut for d in known])
    known_size = ~cut & np.isfinite(size)
    difference = np.where(known_size, np.abs(values[0] - values[1]), 0.0)
    return difference, np.maximum(spread, 1e-9), np.where(known_size, size, 0.0)
