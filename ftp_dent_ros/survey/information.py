"""What two patches tell of their relative pose, and in which directions they tell nothing.

The covariance is that of a jackknife: how much the pose would move if a strip of the skin were
left out. Errors of a cloud are alike along its fringes, and across them along the rows of its
windows; so strips of both kinds are left out, and what either tells is added: clustering in two
ways. Source: A. C. Cameron, D. L. Miller, Journal of Human Resources 50, 317 (2015).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import Array
from ftp_dent_ros.survey.alignment import PairEquations

# Standard deviations of what calibrations leave (20 rendered rigs): focal lengths and
# baselines are off by 0.003 %, which stretches; 0.002 px that the camera or the projector is off
# at its rim are 3 micrometres of height 0.25 m from the middle, which bends, in 1/m.
# Covariance of the six: of x^2, 2 x y and y^2 in the height, and of the stretch along x, in
# shear, and along y; x and y are a patch's.
COMMON = np.diag(np.square([5e-5] * 3 + [3e-5] * 3))
_FORMS = np.array([[[1.0, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]]])


def pair_information(
    found: PairEquations, centre: Array, parallax: Array
) -> tuple[Array, Array, int]:
    """What equations at their solution tell.

    Parameters
    ----------
    found : PairEquations
    centre : ndarray, shape (3,)
        Of what both saw, metres.
    parallax : ndarray, shape (2,)
        Along x and y, how far a place moves between the two views for each metre that it lies
        below the skin.

    Returns
    -------
    step : ndarray, shape (6,)
        To the pose by the patches alone: shift of the centre, and turn.
    information : ndarray, shape (6, 6)
        Inverse covariance; zero in directions that are not known.
    rank : int
        Directions known.
    """
    # Turns are compared with shifts at the overlap's own size.
    arm = float(np.sqrt(np.mean(np.square(found.place - centre).sum(axis=1))))
    scale = np.array([1, 1, 1, 1 / arm, 1 / arm, 1 / arm])
    own, other = found.own * scale, found.other * scale
    product = (found.weight[:, None] * own).T @ other
    values, directions = np.linalg.eigh((product + product.T) / 2)
    own, other = own @ directions, other @ directions
    chance = np.sqrt(np.square(found.weight[:, None] * own * other).sum(axis=0))
    # Standard deviations of what noise would tell by chance, from which on a direction is
    # believed.
    sure = (values > 0) & (values > 5.0 * chance)
    kept = directions[:, sure]
    own, other = own[:, sure], other[:, sure]
    weighted = found.weight[:, None] * own
    pull = (own + other) / 2 * (found.weight * found.residual)[:, None]
    # All marks of a pair lie as deep, so that strips do not show it.
    # Marks lie in relief that the fringes do not resolve (grooves about rivets, edges of paint),
    # so that they move against the skin with the direction they are seen from: its depth, metres.
    moved = 1e-4 * kept[:2].T @ parallax
    # What no pair is better known than, metres: points are rounded to single precision. And what
    # stands for nothing, beside what all strips tell.
    covariance = np.outer(moved, moved) + 1e-7**2 * np.eye(len(moved))
    for strips in (_strips(along) for along in found.place[:, :2].T):
        members = [strips == number for number in range(strips.max() + 1)]
        products = np.array([weighted[each].T @ other[each] for each in members])
        part = (products + np.swapaxes(products, 1, 2)) / 2
        gradients = np.array([pull[each].sum(axis=0) for each in members])
        count, inner = len(part), part.sum(axis=0)
        step = -np.linalg.solve(inner, gradients.sum(axis=0))
        scores = gradients + part @ step
        # Without a strip that alone tells a direction, nothing does.
        left = inner - part + 1e-9 * np.trace(inner) * np.eye(len(inner))
        moves = np.linalg.solve(left, scores[..., None])[..., 0]
        covariance = covariance + (count - 1) / count * moves.T @ moves
    information = kept @ np.linalg.inv(covariance) @ kept.T
    return kept @ step * scale, information / np.outer(scale, scale), int(sure.sum())


def _strips(place: Array) -> NDArray[np.intp]:
    """Number of each point's strip: they are alike in width."""
    low, size = place.min(), max(float(np.ptp(place)), 1e-9)
    # Width of a strip, metres: errors of clouds are alike over some windows of their fringes. And
    # so many that a direction takes at least to be known.
    count = max(3, round(size / 0.04))
    return np.minimum((place - low) / size * count, count - 1).astype(np.intp)


def in_common(centre: Array, pose: Pose) -> Array:
    """How the pose of one patch on another errs with what both have in common.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        Of what both saw, metres, in the first patch's frame.
    pose : Pose
        Of the second patch in the first.

    Returns
    -------
    ndarray, shape (6, 6)
        Change of the shift of the centre and the turn about it, along the first patch's axes.
    """
    here, there = centre[:2], pose.inverse().apply(centre)[:2]
    turn = pose.rotation.as_matrix()[:2, :2]
    result, stretch = np.zeros((6, 6)), _FORMS @ here - _FORMS @ there @ turn.T
    # Heights of the first less those of the second: their value and slope at the centre.
    result[2, :3] = _FORMS @ here @ here - _FORMS @ there @ there
    result[3, :3], result[4, :3] = 2 * stretch[:, 1], -2 * stretch[:, 0]
    result[:2, 3:] = stretch.T
    return result


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Pose of one camera in another's frame, by what both saw.

    Attributes
    ----------
    pose : Pose
        Of the second camera in the first one's frame.
    centre : ndarray, shape (3,)
        About which `information` turns: the middle of what both saw, first camera's frame, metres.
    information : ndarray, shape (6, 6)
        Inverse of the covariance of the twist about `centre`, of shift (metres) and turn
        (radians), along the first camera's axes; zero in directions that the skin does not tell.
    rank : int
        Directions that it does tell, up to 6.
    remark : str
        What could not be used, and why; empty if all could.
    common : ndarray, shape (6, 6)
        How the twist changes with the errors that all clouds of the rig have in common, as
        `in_common` tells.
    """

    pose: Pose
    centre: NDArray[np.float64]
    information: NDArray[np.float64]
    rank: int
    remark: str = ''
    common: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 6)))
