"""Which dents of two surveys are the same, by where they lie to each other and by their sizes.

The aircraft stands elsewhere and otherwise from one survey to the next, and each map errs by
itself. So pairs of neighbouring dents that are as far apart in both surveys each propose a motion;
the one that brings the most dents together begins a deformation, which is followed outward.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from scipy.stats import poisson

from ftp_dent_ros.dents.dent import MeasuredDent
from ftp_dent_ros.dents.sightings import agreement
from ftp_dent_ros.errors import InputError
from ftp_dent_ros.pose import Pose

Array = NDArray[np.float64]

# What a motion may leave of two dents that are the same, beside their places, metres: by its own
# turn, and as the maps stretch.
_LEFT = 2e-3

#: Standard deviation of a dent's centre in its survey, metres.
PLACE = 4e-4
#: Standard deviations within which two are taken for the same.
GATE = 4.0
# Neighbours that a dent makes pairs with; motions that are tried.
_NEIGHBOURS, _TRIED = 8, 400

# The walk is forgotten over so many metres: much longer than what clouds see at once.
_LENGTH = 20.0
# What a motion found from two dents may leave: metres, and radians.
_FREE_SHIFT, _FREE_TURN = 0.05, 0.02
# Variance of a component that a metre of walk adds, square metres: from hundredths of a millimetre
# (clouds laid on each other by their skin) to centimetres (by an autopilot).
_WALKS = np.geomspace(1e-10, 1e-4, 13)


@dataclass(frozen=True, eq=False)
class DentMatching:
    """The dents of a later survey among those of an earlier one.

    Attributes
    ----------
    pairs : tuple of (int, int)
        Index in the earlier survey, and in the later one.
    motion : Pose
        Of the later survey's frame in the earlier one's, roughly.
    forward, backward : Deformation
        From the later survey, moved, to the earlier one, and back.
    """

    pairs: tuple[tuple[int, int], ...]
    motion: Pose
    forward: Deformation
    backward: Deformation

    def in_earlier(self, places: Array) -> tuple[Array, Array]:
        """Places of the later survey in the earlier one, and their standard deviation."""
        moved = self.motion.apply(places)
        shift, spread = self.forward.shift(moved)
        return moved + shift, spread

    def in_later(self, places: Array) -> tuple[Array, Array]:
        """Places of the earlier survey in the later one, and their standard deviation."""
        shift, spread = self.backward.shift(places)
        return self.motion.inverse().apply(places + shift), spread


class NoMatchError(InputError):
    """Two surveys cannot be laid on each other."""


def match(earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent]) -> DentMatching:
    """Find the same dents.

    Parameters
    ----------
    earlier, later : sequence of MeasuredDent
        Each in its survey's frame.

    Raises
    ------
    NoMatchError
        No motion brings enough of them together.
    """
    if min(len(earlier), len(later)) < 3:
        raise NoMatchError(
            f'the surveys have {len(earlier)} and {len(later)} dents, too few to lay them on each '
            'other: survey a larger part of the skin'
        )
    there = np.stack([dent.position for dent in earlier])
    here = np.stack([dent.position for dent in later])
    place = _place(earlier, later)
    agree = agreement(earlier, later)
    best: tuple[float, Pose, list[tuple[int, int]]] | None = None
    motions = motions_between(earlier, later, agree)
    for motion in motions:
        moved = motion.apply(here)
        pairs = _together(there, moved, place, np.isfinite(agree))
        score = len(pairs) - float(
            sum(((there[i] - moved[j]) ** 2).sum() / place[i, j] ** 2 for i, j in pairs)
        ) / (2 * GATE**2 * max(len(pairs), 1))
        if best is None or score > best[0]:
            best = score, motion, pairs
    # Chance that dents of two aircraft are laid on each other.
    if best is None or _by_chance(len(best[2]), len(motions), there, here, place, agree) > 1e-3:
        raise NoMatchError(
            'no motion lays enough dents of the one survey on those of the other: '
            'check that they are of the same aircraft and overlap'
        )
    _, motion, pairs = best
    return _followed(earlier, later, motion, pairs, place)


def _by_chance(
    count: int, tried: int, there: Array, here: Array, place: Array, agree: Array
) -> float:
    """How many motions of those tried bring so many strangers together."""
    axes = np.linalg.svd(there - there.mean(axis=0), full_matrices=False)[2]
    sides = np.ptp((there - there.mean(axis=0)) @ axes[:2].T, axis=0)
    reach = GATE * float(np.median(place)) + _LEFT
    area = float(np.prod(np.maximum(sides, 2 * reach)))
    alike = float(np.isfinite(agree).mean())
    expected = len(here) * min(1.0, len(there) * math.pi * reach**2 / area) * alike
    # Two are brought together by making.
    return tried * float(poisson.sf(count - 3, expected))


def _followed(
    earlier: Sequence[MeasuredDent],
    later: Sequence[MeasuredDent],
    motion: Pose,
    pairs: list[tuple[int, int]],
    place: Array,
) -> DentMatching:
    """From some pairs outward, until nothing is added."""
    there = np.stack([dent.position for dent in earlier])
    moved = motion.apply(np.stack([dent.position for dent in later]))
    signs = [np.array([np.sign(d.depth.value) for d in each]) for each in (earlier, later)]
    alike = signs[0][:, None] == signs[1]
    # Part of the way to the next dent within which a dent is looked for.
    free = np.minimum(_free(there)[:, None], _free(moved)) * 0.4
    # A cut dent has its centre anywhere in it.
    half = np.array([[_half(a, b) for b in later] for a in earlier])
    while True:
        i, j = np.array(pairs).T
        forward = fit(moved[j], there[i] - moved[j], place[i, j] * math.sqrt(2))
        shift, spread = forward.shift(moved)
        off = np.linalg.norm(there[:, None] - (moved + shift), axis=2)
        sigma = np.hypot(spread, math.sqrt(2) * place)
        reach = np.minimum(GATE * sigma + half, np.maximum(free, GATE * place))
        cost = np.where(alike & (off < reach), off / sigma, 1e6)
        rows, columns = linear_sum_assignment(cost)
        found = [(int(a), int(b)) for a, b in zip(rows, columns, strict=True) if cost[a, b] < 1e6]
        if len(found) <= len(pairs):
            break
        pairs = found
    i, j = np.array(pairs).T
    shifts, spreads = there[i] - moved[j], place[i, j] * math.sqrt(2)
    return DentMatching(
        tuple(pairs), motion, fit(moved[j], shifts, spreads), fit(there[i], -shifts, spreads)
    )


def _together(
    there: Array, moved: Array, place: Array, possible: NDArray[np.bool_]
) -> list[tuple[int, int]]:
    """Dents that a motion brings together, each to one other at most; near its middle first."""
    tree = cKDTree(there)
    distance, index = tree.query(moved)
    pairs: dict[int, tuple[float, int]] = {}
    for j, (off, i) in enumerate(zip(distance, index, strict=True)):
        if (
            possible[i, j]
            and off < GATE * place[i, j] + _LEFT
            and (i not in pairs or off < pairs[i][0])
        ):
            pairs[int(i)] = float(off), j
    return [(i, j) for i, (_, j) in pairs.items()]


def _place(earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent]) -> Array:
    widths = [np.nan_to_num([dent.width.value for dent in each]) for each in (earlier, later)]
    # Standard deviation of a dent's centre in its survey, as part of its width.
    return np.hypot(PLACE, 0.015 * np.minimum(widths[0][:, None], widths[1]))


def _half(a: MeasuredDent, b: MeasuredDent) -> float:
    if not (a.is_cut or b.is_cut):
        return 0.0
    return max(np.nan_to_num(a.length.value), np.nan_to_num(b.length.value)) / 2


def _free(places: Array) -> Array:
    """Distance of each place to the next one, metres."""
    distance, _ = cKDTree(places).query(places, k=2)
    return distance[:, 1]


def motions_between(
    earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent], agree: Array
) -> list[Pose]:
    """Motions that lay two neighbours of the later survey on two of the earlier one.

    Parameters
    ----------
    earlier, later : sequence of MeasuredDent
        Each in its survey's frame.
    agree : ndarray, shape (n, m)
        How unlike the sizes of any two are, as `agreement` gives it; infinite where they cannot
        be the same.

    Returns
    -------
    list of Pose
        Those of long pairs of like sizes first.
    """
    a, b = _neighbours(earlier), _neighbours(later)
    if not len(a) or not len(b):
        return []
    lengths = [_lengths(each, pairs) for each, pairs in ((earlier, a), (later, b))]
    # Of the distance of two neighbours, per metre, beside: what maps stretch.
    tolerance = GATE * np.hypot(2 * PLACE, 4e-3 * lengths[0])
    good = np.abs(lengths[0][:, None] - lengths[1]) < tolerance[:, None]
    sizes = agree[a[:, 0]][:, b[:, 0]] + agree[a[:, 1]][:, b[:, 1]]
    good &= np.isfinite(sizes)
    rows, columns = np.nonzero(good)
    # Long ones of like sizes say the most.
    order = np.argsort(sizes[rows, columns] - np.log(lengths[0][rows]), kind='stable')[:_TRIED]
    motions = (_motion(earlier, later, a[rows[k]], b[columns[k]]) for k in order)
    return [motion for motion in motions if motion is not None]


def _motion(
    earlier: Sequence[MeasuredDent],
    later: Sequence[MeasuredDent],
    there: NDArray[np.intp],
    here: NDArray[np.intp],
) -> Pose | None:
    """Motion by two places and the skin's normals at them."""
    frames = []
    for dents, (first, second) in ((earlier, there), (later, here)):
        along = dents[second].position - dents[first].position
        normal = dents[first].normal + dents[second].normal
        across = np.cross(normal, along)
        if np.linalg.norm(across) < 1e-9:
            return None
        along, across = along / np.linalg.norm(along), across / np.linalg.norm(across)
        middle = (dents[first].position + dents[second].position) / 2
        frames.append((np.stack([along, across, np.cross(along, across)], axis=1), middle))
    (one, origin), (other, start) = frames
    turn = Rotation.from_matrix(one @ other.T)
    return Pose(turn, origin - turn.apply(start))


def _neighbours(dents: Sequence[MeasuredDent]) -> NDArray[np.intp]:
    """Ordered pairs of each whole dent and its neighbours, shape (n, 2)."""
    whole = np.array([k for k, dent in enumerate(dents) if not dent.is_cut], np.intp)
    if len(whole) < 2:
        return np.zeros((0, 2), np.intp)
    places = np.stack([dents[k].position for k in whole])
    _, index = cKDTree(places).query(places, k=min(_NEIGHBOURS + 1, len(whole)))
    first = np.repeat(np.arange(len(whole)), index.shape[1] - 1)
    return np.stack([whole[first], whole[index[:, 1:].ravel()]], axis=1)


def _lengths(dents: Sequence[MeasuredDent], pairs: NDArray[np.intp]) -> Array:
    places = np.stack([dent.position for dent in dents])
    return np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)


@dataclass(frozen=True, eq=False)
class Deformation:
    """Where places of one map lie in the other.

    Attributes
    ----------
    at : ndarray, shape (n, 3)
        Places that were matched, metres, about `middle`.
    middle : ndarray, shape (3,)
    weights : ndarray, shape (n, 3)
        Of the kriging.
    factor : tuple
        Cholesky factor of the covariance of the n shifts along each axis.
    walk : float
        Variance that a metre adds, square metres.
    """

    at: Array
    middle: Array
    weights: Array
    factor: tuple[Array, bool]
    walk: float

    def shift(self, places: Array) -> tuple[Array, Array]:
        """Shifts of places, shape (m, 3), and the standard deviation of each, shape (m,)."""
        places = places - self.middle
        across = _covariance(places, self.at, self.walk)
        prior = _FREE_SHIFT**2 + _FREE_TURN**2 * (places**2).sum(axis=1) + self.walk * _LENGTH
        explained = (across * cho_solve(self.factor, across.T).T).sum(axis=1)
        return across @ self.weights, np.sqrt(np.maximum(prior - explained, 0.0))


def fit(at: Array, shifts: Array, spreads: Array) -> Deformation:
    """The likeliest deformation.

    Parameters
    ----------
    at, shifts : ndarray, shape (n, 3)
        Places and their shifts into the other map, metres; n is at least 1.
    spreads : ndarray, shape (n,)
        Standard deviation of each shift without the maps' own errors, metres.
    """
    middle = at.mean(axis=0)
    best: tuple[float, Deformation] | None = None
    for walk in _WALKS:
        covariance = _covariance(at - middle, at - middle, walk) + np.diag(spreads**2)
        factor = cho_factor(covariance, lower=True)
        weights = cho_solve(factor, shifts)
        likelihood = -0.5 * float((shifts * weights).sum())
        likelihood -= 3 * float(np.log(np.diag(factor[0])).sum())
        # What is expected of it before there are dents: a millimetre over a metre, give or take a
        # factor of ten (natural logarithm of a variance).
        likelihood -= 0.5 * (float(np.log(walk / 1e-6)) / 4.6) ** 2
        if best is None or likelihood > best[0]:
            best = likelihood, Deformation(at - middle, middle, weights, factor, float(walk))
    assert best is not None
    return best[1]


def _covariance(a: Array, b: Array, walk: float) -> Array:
    """Of the shifts along one axis at two sets of places about the middle."""
    rigid = _FREE_SHIFT**2 + _FREE_TURN**2 * a @ b.T
    return rigid + walk * _LENGTH * np.exp(-cdist(a, b) / _LENGTH)
