"""Which dents of two surveys are the same, by where they lie to each other and by their sizes.

The aircraft stands elsewhere and otherwise from one survey to the next, and each map errs by
itself. So pairs of neighbouring dents that are as far apart in both surveys each propose a motion;
the one that most agree with begins a deformation, which is followed outward.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from ftp_dent_ros.dents.dent import MeasuredDent
from ftp_dent_ros.dents.sightings import CENTRE, agreement, assigned, centre_deviations
from ftp_dent_ros.errors import InputError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import Array
from ftp_dent_ros.survey.tying import REACH, agreeing

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
#: Shifts of places into the other map, and their standard deviations.
Deformation = Callable[[Array], tuple[Array, Array]]

# Standard deviations within which two are taken for the same.
_GATE = 4.0
# The walk is forgotten over so many metres: much longer than what clouds see at once.
_LENGTH = 20.0
# What a motion found from two dents may leave: metres, and radians.
_FREE_SHIFT, _FREE_TURN = 0.05, 0.02


@dataclass(frozen=True, eq=False)
class DentMatching:
    """The dents of a later survey among those of an earlier one.

    Attributes
    ----------
    pairs : tuple of (int, int)
        Index in the earlier survey, and in the later one.
    motion : Pose
        Of the later survey's frame in the earlier one's, roughly.
    deformation : Deformation
        From the later survey, moved, to the earlier one.
    """

    pairs: tuple[tuple[int, int], ...]
    motion: Pose
    deformation: Deformation

    def in_earlier(self, places: Array) -> tuple[Array, Array]:
        """Places of the later survey in the earlier one, and their standard deviation."""
        moved = self.motion.apply(places)
        shift, spread = self.deformation(moved)
        return moved + shift, spread

    def in_later(self, places: Array) -> Array:
        """Places of the earlier survey in the later one."""
        # Shifts change by a hundredth of the way, so that two steps leave micrometres.
        shift, _ = self.deformation(places)
        shift, _ = self.deformation(places - shift)
        return self.motion.inverse().apply(places - shift)

    def spread(self, place: Array) -> float:
        """Standard deviation of a place of the later survey in the earlier one."""
        return float(self.in_earlier(place[None])[1][0])

    def near(self, place: Array) -> Pose:
        """Of the earlier survey's frame in the later one's, about a place of the earlier one."""
        turn = self.motion.rotation.inv()
        return Pose(turn, self.in_later(place[None])[0] - turn.apply(place))


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
    there, here = _positions(earlier), _positions(later)
    place, agree = centre_deviations(earlier, later), agreement(earlier, later)
    motions, ours, theirs = _proposals(earlier, later, agree)
    like = len(there) * float(np.isfinite(agree).mean())
    chance = like * math.pi * REACH**2 / _area(there)
    same = agreeing(motions, here[ours].mean(axis=1), ours, chance)
    if not len(same):
        raise NoMatchError(
            'no motion lays enough dents of the one survey on those of the other: '
            'check that they are of the same aircraft and overlap'
        )
    motion = motions[same[0]]
    begin = theirs[same[0]], ours[same[0]]
    (i, j), deformation = _followed_pairs(earlier, later, motion.apply(here), place, begin)
    return DentMatching(tuple(zip(i.tolist(), j.tolist(), strict=True)), motion, deformation)


def _positions(dents: Sequence[MeasuredDent]) -> Array:
    return np.stack([dent.position for dent in dents])


def _area(places: Array) -> float:
    """Of the rectangle that places spread over, square metres."""
    off = places - places.mean(axis=0)
    sides = np.ptp(off @ np.linalg.svd(off, full_matrices=False)[2][:2].T, axis=0)
    return float(np.prod(np.maximum(sides, 2 * REACH)))


def _followed_pairs(
    earlier: Sequence[MeasuredDent],
    later: Sequence[MeasuredDent],
    moved: Array,
    place: Array,
    pairs: Pairs,
) -> tuple[Pairs, Deformation]:
    """From some pairs outward, until nothing is added; and how these lie to each other."""
    there = _positions(earlier)
    signs, lengths, cut = (
        [np.nan_to_num([of(dent) for dent in dents]) for dents in (earlier, later)]
        for of in (
            lambda dent: np.sign(dent.depth.value),
            lambda dent: dent.length.value,
            lambda dent: dent.is_cut,
        )
    )
    alike = np.equal.outer(*signs)
    # A cut dent has its centre anywhere in it.
    half = np.maximum.outer(*cut) * np.maximum.outer(*lengths) / 2
    while True:
        i, j = pairs
        deformation = _fit(moved[j], there[i] - moved[j], place[i, j])
        shift, spread = deformation(moved)
        off = cdist(there, moved + shift)
        sigma = np.hypot(spread, math.sqrt(2) * place)
        found = assigned(np.where(alike & (off < _GATE * sigma + half), off / sigma, np.inf))
        if len(found[0]) <= len(i):
            return pairs, deformation
        pairs = found


def _proposals(
    earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent], agree: Array
) -> tuple[list[Pose], NDArray[np.intp], NDArray[np.intp]]:
    """Motions that lay two neighbours of the later survey on two of the earlier one.

    And numbers of these, shape (n, 2). Those of long pairs of like sizes are first, as they say
    the most.
    """
    a, b = _neighbours(earlier), _neighbours(later)
    # Each two once.
    b = np.unique(np.sort(b, axis=1), axis=0)
    lengths = [
        np.linalg.norm(np.diff(_positions(dents)[pairs], axis=1)[:, 0], axis=1)
        for dents, pairs in ((earlier, a), (later, b))
    ]
    # Of the distance of two neighbours, per metre, beside: what maps stretch.
    tolerance = _GATE * np.hypot(2 * CENTRE, 4e-3 * lengths[0])
    sizes = agree[a[:, 0]][:, b[:, 0]] + agree[a[:, 1]][:, b[:, 1]]
    good = np.abs(lengths[0][:, None] - lengths[1]) < tolerance[:, None]
    rows, columns = np.nonzero(good & np.isfinite(sizes) & (lengths[0] > 0)[:, None])
    # So many are tried.
    order = np.argsort(sizes[rows, columns] - np.log(lengths[0][rows]), kind='stable')[:400]
    theirs, ours, motions = a[rows[order]], b[columns[order]], []
    for one, other in zip(ours, theirs, strict=True):
        (here, middle), (there, onto) = (
            _pair([dents[n] for n in pair]) for dents, pair in ((later, one), (earlier, other))
        )
        turn, _ = Rotation.align_vectors(there, here)
        motions.append(Pose(turn, onto - turn.apply(middle)))
    return motions, ours, theirs


def _pair(dents: Sequence[MeasuredDent]) -> tuple[Array, Array]:
    """From one place to the other and the skin's normal, shape (2, 3), and the middle of both."""
    along = dents[1].position - dents[0].position
    normal = np.mean([dent.normal for dent in dents], axis=0)
    return np.stack([along / np.linalg.norm(along), normal]), _positions(dents).mean(axis=0)


def _neighbours(dents: Sequence[MeasuredDent]) -> NDArray[np.intp]:
    """Ordered pairs of each whole dent and its neighbours, shape (n, 2)."""
    whole = np.array([k for k, dent in enumerate(dents) if not dent.is_cut], np.intp)
    if len(whole) < 2:
        return np.zeros((0, 2), np.intp)
    places = _positions(dents)[whole]
    # Eight neighbours, and the dent itself.
    _, index = cKDTree(places).query(places, k=min(8 + 1, len(whole)))
    first = np.repeat(np.arange(len(whole)), index.shape[1] - 1)
    return whole[np.stack([first, index[:, 1:].ravel()], axis=1)]


def _shift(
    at: Array, weights: Array, factor: tuple[Array, bool], walk: float, places: Array
) -> tuple[Array, Array]:
    """Shifts of places, shape (m, 3), and the standard deviation of each, shape (m,), by kriging.

    Parameters
    ----------
    at, weights : ndarray, shape (n, 3)
        Places that were matched, metres, and their weights.
    factor : tuple
        Cholesky factor of the covariance of the n shifts along each axis.
    walk : float
        Variance that a metre adds, square metres.
    places : ndarray, shape (m, 3)
    """
    across = _covariance(places, at, walk)
    prior = _FREE_SHIFT**2 + _FREE_TURN**2 * (places**2).sum(axis=1) + walk * _LENGTH
    explained = (across * cho_solve(factor, across.T).T).sum(axis=1)
    return across @ weights, np.sqrt(np.maximum(prior - explained, 0.0))


def _fit(at: Array, shifts: Array, spreads: Array) -> Deformation:
    """The likeliest deformation.

    Parameters
    ----------
    at, shifts : ndarray, shape (n, 3)
        Places and their shifts into the other map, metres; n is at least 1.
    spreads : ndarray, shape (n,)
        Standard deviation of each of both places without the maps' own errors, metres.
    """
    fits = []
    # Variance of a component that a metre of walk adds, square metres: from hundredths of a
    # millimetre (clouds laid on each other by their skin) to centimetres (by an autopilot).
    for walk in np.geomspace(1e-10, 1e-4, 13):
        covariance = _covariance(at, at, walk) + np.diag(2 * spreads**2)
        factor = cho_factor(covariance, lower=True)
        weights = cho_solve(factor, shifts)
        likelihood = -0.5 * float((shifts * weights).sum())
        likelihood -= 3 * float(np.log(np.diag(factor[0])).sum())
        # What is expected of it before there are dents: a millimetre over a metre, give or take a
        # factor of ten (natural logarithm of a variance).
        likelihood -= 0.5 * (float(np.log(walk / 1e-6)) / 4.6) ** 2
        fits.append((likelihood, partial(_shift, at, weights, factor, float(walk))))
    return max(fits, key=lambda fit: fit[0])[1]


def _covariance(a: Array, b: Array, walk: float) -> Array:
    """Of the shifts along one axis at two sets of places."""
    rigid = _FREE_SHIFT**2 + _FREE_TURN**2 * a @ b.T
    return rigid + walk * _LENGTH * np.exp(-cdist(a, b) / _LENGTH)
