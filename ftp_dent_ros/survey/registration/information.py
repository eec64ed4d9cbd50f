"""What two patches tell of their relative pose, and in which directions they tell nothing.

The covariance is that of a jackknife: how much the pose would move if a strip of the skin were
left out. Errors of a cloud are alike along its fringes, and across them along the rows of its
windows; so strips of both kinds are left out, and what either tells is added: clustering in two
ways. Source: A. C. Cameron, D. L. Miller, Journal of Human Resources 50, 317 (2015).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.survey.registration.alignment import Equations

Array = NDArray[np.float64]

# Width of a strip, metres: errors of clouds are alike over some windows of their fringes.
_STRIP = 0.04
# Strips each way, and squares as wide as a strip, that a direction takes at least to be told.
_LEAST_STRIPS, _LEAST_SQUARES = 3, 12
# Standard deviations of what noise would tell by chance, from which on a direction is believed.
_SURE = 5.0
# Marks lie in relief that the fringes do not resolve (grooves about rivets, edges of paint), so
# that they move against the skin with the direction they are seen from: its depth, metres.
_RELIEF = 1e-4
# What no pair is better known than, metres: points are rounded to single precision. And what
# stands for nothing, beside what all strips tell.
_LEAST, _NOTHING = 1e-7, 1e-9


@dataclass(frozen=True, eq=False)
class Told:
    """What is told.

    Attributes
    ----------
    step : ndarray, shape (6,)
        To the pose that the patches alone tell: shift of the centre, and turn.
    information : ndarray, shape (6, 6)
        Inverse covariance; zero in directions that are not told.
    count : int
        Directions told.
    """

    step: NDArray[np.float64]
    information: NDArray[np.float64]
    count: int


def told_by(found: Equations, centre: Array, parallax: Array) -> Told:
    """What equations at their solution tell.

    Parameters
    ----------
    found : Equations
    centre : ndarray, shape (3,)
        Of what both saw, metres.
    parallax : ndarray, shape (2,)
        Along x and y, how far a place moves between the two views for each metre that it lies
        below the skin.
    """
    # Turns are compared with shifts at the overlap's own size.
    arm = float(np.sqrt(np.mean(np.square(found.place - centre).sum(axis=1))))
    scale = np.array([1, 1, 1, 1 / arm, 1 / arm, 1 / arm])
    own, other = found.own * scale, found.other * scale
    product = (found.weight[:, None] * own).T @ other
    values, directions = np.linalg.eigh((product + product.T) / 2)
    own, other = own @ directions, other @ directions
    chance = np.sqrt(np.square(found.weight[:, None] * own * other).sum(axis=0))
    sure = (values > 0) & (values > _SURE * chance)
    kept = directions[:, sure]
    ways = [_strips(found.place[:, axis]) for axis in (0, 1)]
    squares = np.unique(ways[0] + (ways[0].max() + 1) * ways[1])
    if not sure.any() or len(squares) < _LEAST_SQUARES:
        return Told(np.zeros(6), np.zeros((6, 6)), 0)
    own, other = own[:, sure], other[:, sure]
    weighted, pull = found.weight[:, None] * own, (found.weight * found.residual)[:, None]
    # All marks of a pair lie as deep, so that strips do not show it.
    moved = _RELIEF * kept[:2].T @ parallax
    covariance = np.outer(moved, moved) + _LEAST**2 * np.eye(len(moved))
    for strips in ways:
        part = _products(weighted, other, strips)
        gradients = _summed((own + other) / 2 * pull, strips)
        count, inner = len(part), part.sum(axis=0)
        step = -np.linalg.solve(inner, gradients.sum(axis=0))
        scores = gradients + part @ step
        # Without a strip that alone tells a direction, nothing does.
        left = inner - part + _NOTHING * np.trace(inner) * np.eye(len(inner))
        moves = np.linalg.solve(left, scores[..., None])[..., 0]
        covariance = covariance + (count - 1) / count * moves.T @ moves
    information = kept @ np.linalg.inv(covariance) @ kept.T
    return Told(kept @ step * scale, information / np.outer(scale, scale), int(sure.sum()))


def _strips(place: Array) -> NDArray[np.intp]:
    """Number of each point's strip: they are alike in width."""
    low, size = place.min(), max(float(np.ptp(place)), 1e-9)
    count = max(_LEAST_STRIPS, round(size / _STRIP))
    return np.minimum((place - low) / size * count, count - 1).astype(np.intp)


def _products(own: Array, other: Array, strips: NDArray[np.intp]) -> Array:
    """Symmetric sums of products of slopes in each strip, shape (strips, n, n)."""
    # One product of matrices a strip takes a tenth of sums over all points for each element.
    order = np.argsort(strips, kind='stable')
    ends = np.searchsorted(strips[order], np.arange(strips.max() + 2))
    own, other = own[order], other[order]
    sums = np.array([own[a:b].T @ other[a:b] for a, b in pairwise(ends)])
    return (sums + np.swapaxes(sums, 1, 2)) / 2


def _summed(values: NDArray, strips: NDArray[np.intp]) -> NDArray[np.float64]:
    return np.stack([np.bincount(strips, each) for each in values.T], axis=-1)
