"""Places of one patch on another between which has to be decided: by paint, shape and the guess.

Skins repeat themselves: a row of rivets lies on itself again a pitch farther. What decides
between two places is what does not repeat itself, and how far the guess lies from either.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.patches.patch import Patch
from ftp_dent_ros.survey.registration.alignment import Samples, moved, of_paint

# Standard deviations of the evidence against a place beyond which it is not the right one.
_CLEARLY = 4.5
# Points near each other err alike, and count as so many fewer: rendered rivets of four pitches,
# and nothing else, tell their pitches apart by 1.8 standard deviations too often.
_ALIKE = 3.3
# Nearer than this they are one, metres: the cells in which places are looked for.
_SAME = 0.003
# Directions in which a patch slides on another, and steps until it lies there.
_SLIDING, _STEPS = [0, 1, 5], 2

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Guess:
    """Where the second patch is thought to lie on the first one.

    Attributes
    ----------
    pose : Pose
    centre : ndarray, shape (3,)
        Of what both see, metres.
    doubt : ndarray, shape (6, 6)
        Covariance of the shift of the centre, and of the turn about it.
    """

    pose: Pose
    centre: Array
    doubt: Array

    def away(self, pose: Pose) -> tuple[Array, float]:
        """How far along the skin a pose shifts the centre, and the square of it in sigmas."""
        shift = ((pose @ self.pose.inverse()).apply(self.centre) - self.centre)[:2]
        return shift, float(shift @ np.linalg.solve(self.doubt[:2, :2], shift))


@dataclass(frozen=True, eq=False)
class Place:
    """A place of the second patch on the first.

    Attributes
    ----------
    pose : Pose
        Of the second patch in the first.
    shift : ndarray, shape (2,)
        Of the middle of what both see, along the skin, from the guess, metres.
    unlikely : float
        Square of that, in standard deviations.
    misfits : tuple of ndarrays, shape (n,)
        How far the samples' paints, and their heights, differ from what is below them; NaN where
        nothing is. Empty where the patches do not overlap: then the guess alone decides.
    """

    pose: Pose
    shift: Array
    unlikely: float
    misfits: tuple[Array, ...]

    @classmethod
    def at(
        cls, first: Patch, samples: Samples, pose: Pose, near: Guess, rough: bool = False
    ) -> Place:
        """Look up what lies below the samples; roughly: by the coarse paint alone."""
        layer, values = (
            (first.coarse, samples.coarse_values) if rough else (first.paint, samples.paint_values)
        )
        below = first.looked_up(layer, pose.apply(samples.paint))
        met = (below[:, 3] > 0.99) & (values[:, 3] > 0)
        misfits = [np.where(met, np.abs(below[:, 0] - values[:, 0]), np.nan)]
        if not rough:
            place = pose.apply(samples.heights)
            below = first.looked_up(first.surface, place)
            sigma = np.hypot(below[:, 3], samples.height_values[:, 3])
            misfits.append(np.abs(place[:, 2] - below[:, 0]) / sigma)
        shift, unlikely = near.away(pose)
        return cls(pose, shift, unlikely, tuple(misfits))

    def is_same(self, other: Place) -> bool:
        """Whether both are one place, found twice."""
        return bool(np.hypot(*(self.shift - other.shift)) < _SAME)

    def evidence_against(self, other: Place) -> float:
        """Twice the logarithm of the odds of another place against this one.

        Only what is seen at both is compared. Misfits have long tails, so that their differences
        are counted by their own size: as a sum of so many standard deviations.
        """
        evidence = self.unlikely - other.unlikely
        for mine, others in zip(self.misfits, other.misfits, strict=False):
            gain = mine - others
            gain = gain[np.isfinite(gain)]
            square = np.square(gain).sum()
            if square > 0:
                evidence += gain.sum() * abs(gain.sum()) / (square * _ALIKE)
        return float(evidence)


def slid(first: Patch, samples: Samples, pose: Pose, centre: Array, held: Array) -> Pose:
    """Where the coarse paints lie on each other near a pose, as it slides and turns on the skin.

    Parameters
    ----------
    held : ndarray, shape (6, 6)
        Inverse covariance of how far that may be.
    """
    free = np.ix_(_SLIDING, _SLIDING)
    for _ in range(_STEPS):
        (residual, own, other, weight, _), _ = of_paint(first, samples, pose, centre, coarse=True)
        both = (own + other)[:, _SLIDING] / 2
        normal = both.T @ (both * weight[:, None]) + held[free]
        step = np.zeros(6)
        step[_SLIDING] = -np.linalg.solve(normal, both.T @ (weight * residual))
        pose = moved(pose, step, centre)
    return pose


def not_worse(places: Iterable[Place], most: int) -> list[Place]:
    """Of some places the best, and those that are not clearly worse, in order of evidence."""
    others = iter(places)
    best = next(others, None)
    left: list[Place] = []
    if best is None:
        return left
    for place in others:
        if place.is_same(best):
            continue
        evidence = place.evidence_against(best)
        if evidence < 0:
            best, place, evidence = place, best, -evidence
        if evidence < _CLEARLY**2:
            left.append(place)
        if len(left) > most:
            break
    left = [each for each in left if not each.is_same(best)]
    against = [(each.evidence_against(best), each) for each in left]
    against = sorted((each for each in against if each[0] < _CLEARLY**2), key=lambda each: each[0])
    return [best, *(place for _, place in against)]
