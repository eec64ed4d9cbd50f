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
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.stats import poisson

from ftp_dent_ros.errors import InputError
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.tracking.agreement import agreement
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.comparing.deformation import Deformation, fit
from ftp_dent_ros.survey.comparing.motions import GATE, PLACE, motions_between

Array = NDArray[np.float64]

# Standard deviation of a dent's centre in its survey, as part of its width.
_OF_WIDTH = 0.015
# Part of the way to the next dent within which a dent is looked for.
_FREE = 0.4
# What a motion may leave of two dents that are the same, beside their places, metres: by its own
# turn, and as the maps stretch.
_LEFT = 2e-3
# Chance that dents of two aircraft are laid on each other.
_CHANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Matching:
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


def match(earlier: Sequence[MeasuredDent], later: Sequence[MeasuredDent]) -> Matching:
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
    if best is None or _by_chance(len(best[2]), len(motions), there, here, place, agree) > _CHANCE:
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
) -> Matching:
    """From some pairs outward, until nothing is added."""
    there = np.stack([dent.position for dent in earlier])
    moved = motion.apply(np.stack([dent.position for dent in later]))
    signs = [np.array([np.sign(d.depth.value) for d in each]) for each in (earlier, later)]
    alike = signs[0][:, None] == signs[1]
    free = np.minimum(_free(there)[:, None], _free(moved)) * _FREE
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
    return Matching(
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
    return np.hypot(PLACE, _OF_WIDTH * np.minimum(widths[0][:, None], widths[1]))


def _half(a: MeasuredDent, b: MeasuredDent) -> float:
    if not (a.is_cut or b.is_cut):
        return 0.0
    return max(np.nan_to_num(a.length.value), np.nan_to_num(b.length.value)) / 2


def _free(places: Array) -> Array:
    """Distance of each place to the next one, metres."""
    distance, _ = cKDTree(places).query(places, k=2)
    return distance[:, 1]
