"""What two patches tell of their relative pose, and in which directions they tell nothing.

The covariance is that of a jackknife over blocks of the skin: how much the pose would move if a
block were left out. Errors that are alike within a block, and weights that are wrong, are in it.
Source: A. C. Cameron, D. L. Miller, Journal of Human Resources 50, 317 (2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.survey.alignment import Equations

Array = NDArray[np.float64]

# Side of a block, metres: errors of clouds are alike over some windows of their fringes.
_BLOCK = 0.04
# Blocks that a direction takes at least to be told.
_LEAST_BLOCKS = 12
# Standard deviations of what noise would tell by chance, from which on a direction is believed.
_SURE = 5.0
# What no pair of the same view is better than, along the skin and the normal, metres: a thirtieth
# of a grid point, for light and fringes that stay with the camera, and what a rig's calibration
# leaves. By a smaller overlap less of what stays with the camera averages out.
_ALONG, _NORMAL = 3e-5, 1e-6
# Marks lie in relief that the fringes do not resolve (grooves about rivets, edges of paint), so
# that they move against the skin with the direction they are seen from: its depth, metres.
_RELIEF = 1e-4


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


def told_by(
    found: Equations,
    centre: NDArray[np.float64],
    overlap: float,
    parallax: NDArray[np.float64],
) -> Told:
    """What equations at their solution tell.

    Parameters
    ----------
    found : Equations
    centre : ndarray, shape (3,)
        Of what both saw, metres.
    overlap : float
        Share of the second patch that lies on the first.
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
    blocks, count = _blocks(found.place)
    if not sure.any() or count < _LEAST_BLOCKS:
        return Told(np.zeros(6), np.zeros((6, 6)), 0)
    own, other = own[:, sure], other[:, sure]
    pull = (found.weight * found.residual)[:, None]
    part = _products(found.weight[:, None] * own, other, blocks, count)
    gradients = _summed((own + other) / 2 * pull, blocks, count)
    inner = part.sum(axis=0)
    step = -np.linalg.solve(inner, gradients.sum(axis=0))
    scores = gradients + part @ step
    left = inner - part
    moves = np.linalg.solve(left, scores[..., None])[..., 0]
    covariance = (count - 1) / count * moves.T @ moves
    # What is alike all over both clouds does not show in differences between blocks.
    covariance = covariance + kept.T @ _alike(found, overlap, parallax, arm) @ kept
    information = kept @ np.linalg.inv(covariance) @ kept.T
    return Told(kept @ step * scale, information / np.outer(scale, scale), int(sure.sum()))


def _alike(found: Equations, overlap: float, parallax: Array, arm: float) -> Array:
    """Covariance by errors that are alike all over both clouds, turns times the arm."""
    covariance = np.diag(np.square([_ALONG, _ALONG, _NORMAL, 0, 0, _ALONG]))
    covariance[:2, :2] /= overlap
    covariance[:2, :2] += _RELIEF**2 * np.outer(parallax, parallax)
    # The narrower the overlap, the more the same error of heights turns it.
    at = found.place[~found.is_paint, :2]
    slopes = (_NORMAL * arm) ** 2 * np.linalg.inv(np.cov(at.T, bias=True))
    covariance[3:5, 3:5] = [[slopes[1, 1], -slopes[0, 1]], [-slopes[0, 1], slopes[0, 0]]]
    return covariance


def _blocks(place: NDArray[np.float64]) -> tuple[NDArray[np.intp], int]:
    """Number of each point's block, and how many there are."""
    cell = np.floor((place[:, :2] - place[:, :2].min(axis=0)) / _BLOCK).astype(int)
    flat = cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]
    used = np.bincount(flat) > 0
    return (np.cumsum(used) - 1)[flat], int(used.sum())


def _products(own: Array, other: Array, blocks: NDArray, count: int) -> Array:
    """Symmetric sums of products of slopes in each block, shape (blocks, n, n)."""
    size = own.shape[1]
    sums = np.empty((count, size, size))
    for row in range(size):
        for column in range(row + 1):
            both = own[:, row] * other[:, column] + own[:, column] * other[:, row]
            sums[:, row, column] = sums[:, column, row] = np.bincount(blocks, both, count) / 2
    return sums


def _summed(values: NDArray, blocks: NDArray, count: int) -> NDArray[np.float64]:
    return np.stack([np.bincount(blocks, each, count) for each in values.T], axis=-1)
