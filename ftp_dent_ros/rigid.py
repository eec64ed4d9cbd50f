"""Small rigid motions, SE(3): errors of one pose, and twists of many at once.

A motion along which a plane, a cylinder or any other surface slides on itself is a straight line
of twists (shift of a place and turn about it, shape (6,)). So what two clouds do not tell of their
places stays one direction, however far they are from where it was worked out. Source: J. Sola, J.
Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics", arXiv:1812.01537
(2018).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose

Array = NDArray[np.float64]


def move_about(error: Array, pivot: Array) -> Pose:
    """Pose that shifts a pivot and turns about it by an error (shift, turn)."""
    rotation = Rotation.from_rotvec(error[3:])
    return Pose(rotation, pivot - rotation.apply(pivot) + error[:3])


def about(lever: Array) -> Array:
    """How an error of a pose (shift, turn) moves points at levers from it, shape (..., 3, 6)."""
    turned = -crossed(lever)
    return np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=-1)


def seen_along(covariance: Array, axes: Array, arm: Array) -> Array:
    """Covariance of an error (shift, turn), as of the shift at an arm, along other axes.

    Parameters
    ----------
    covariance : ndarray, shape (6, 6)
    axes : ndarray, shape (3, 3)
        The other axes, columns.
    arm : ndarray, shape (3,)
        From where the error shifts to where it is asked for, metres.
    """
    change = np.kron(np.eye(2), axes).T @ np.vstack([about(arm), np.eye(3, 6, 3)])
    return change @ covariance @ change.T


def moved(pose: Pose, step: Array, centre: Array) -> Pose:
    """A pose after a shift of a centre and a turn about it, shape (6,)."""
    return move_about(step, centre) @ pose


def moved_along(pose: Pose, twist: Array, centre: Array) -> Pose:
    """A pose after a twist about a centre, shape (6,)."""
    turn, shift = (each[0] for each in motions(twist[None]))
    rotation = Rotation.from_matrix(turn)
    return Pose(rotation, centre + shift - rotation.apply(centre)) @ pose


def twist_between(pose: Pose, other: Pose, centre: Array) -> Array:
    """Twist about a centre that takes a pose to another one, shape (6,)."""
    off = other @ pose.inverse()
    return twists(off.rotation.as_matrix(), off.apply(centre) - centre)


def fit_move(ours: Array, theirs: Array, place: Array, pivot: Array, covariance: Array) -> Pose:
    """Small turn and shift by least squares, with the pose's as a prior."""
    normal = np.linalg.inv(covariance + 1e-14 * np.eye(6))
    right = np.zeros(6)
    for here, there, spread in zip(ours, theirs, place, strict=True):
        jacobian = about(here - pivot) / spread
        normal += jacobian.T @ jacobian
        right += jacobian.T @ ((there - here) / spread)
    return move_about(np.linalg.solve(normal, right), pivot)


def cross(one: Array, other: Array) -> Array:
    """Cross products of vectors of shape (n, 3); NumPy's takes several times as long."""
    (x, y, z), (u, v, w) = one.T, other.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def crossed(vectors: Array) -> Array:
    """Matrices whose product is the cross product with vectors, shape (n, 3, 3)."""
    return np.cross(np.eye(3), vectors[..., None, :])


def rotation_vectors(turns: Array) -> Array:
    """Rotation vectors of matrices of shape (n, 3, 3) that turn by less than half a turn."""
    skew = (turns - np.swapaxes(turns, -1, -2)) / 2
    axis = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    sine = np.linalg.norm(axis, axis=-1)
    cosine = (np.trace(turns, axis1=-2, axis2=-1) - 1) / 2
    angle = np.arctan2(sine, cosine)
    return axis * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[..., None]


def twists(turns: Array, shifts: Array) -> Array:
    """Twists of motions, each a turn about a place and a shift of it; shape (n, 6)."""
    vectors = rotation_vectors(turns)
    square = np.square(vectors).sum(axis=-1)[..., None, None]
    cross = crossed(vectors)
    # Series of the inverse of the left Jacobian of rotations: exact to 1e-9 at one radian.
    series = 1 / 12 + square / 720 + square**2 / 30240 + square**3 / 1209600
    back = np.eye(3) - cross / 2 + series * (cross @ cross)
    return np.concatenate([(back @ shifts[..., None])[..., 0], vectors], axis=-1)


def motions(twist: Array) -> tuple[Array, Array]:
    """Turns about a place and shifts of it, shape (n, 3, 3) and (n, 3), of twists, (n, 6)."""
    vectors = twist[:, 3:]
    square = np.square(vectors).sum(axis=-1)[:, None, None]
    angle = np.sqrt(square)
    # (1 - cos) / square, and (1 - sin / angle) / square, by its series where that is small.
    half = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    rest = (1 - np.sinc(angle / np.pi)) / np.maximum(square, 1e-4)
    rest = np.where(square < 1e-4, 1 / 6 - square / 120, rest)
    cross = crossed(vectors)
    along = np.eye(3) + half * cross + rest * (cross @ cross)
    turns = np.eye(3) + cross @ along
    return turns, (along @ twist[:, :3, None])[..., 0]


def changes(twist: Array) -> Array:
    """How twists of shape (n, 6) change with a small motion after them, shape (n, 6, 6)."""
    bracket = np.zeros((*twist.shape, 6))
    bracket[..., :3, :3] = bracket[..., 3:, 3:] = crossed(twist[..., 3:])
    bracket[..., :3, 3:] = crossed(twist[..., :3])
    return np.eye(6) - bracket / 2 + bracket @ bracket / 12


def spread_of_shift(covariance: Array) -> Array:
    """Covariance of shifts and turns, of that of twists; both of shape (n, 6, 6).

    What turns on its way is shifted along an arc: by ``shift + turn x shift / 2``, of which the
    second part's mean square is added. Source of the moments: T. D. Barfoot, P. T. Furgale, IEEE
    Transactions on Robotics 30, 679 (2014).
    """
    shift, turn = covariance[:, :3, :3], covariance[:, 3:, 3:]
    both = covariance[:, 3:, :3]
    # Of turn_j shift_k turn_m shift_n.
    fourth = (
        np.einsum('ajm,akn->ajkmn', turn, shift)
        + np.einsum('ajn,amk->ajkmn', both, both)
        + np.einsum('ajk,amn->ajkmn', both, both)
    )
    cross = crossed(np.eye(3)).transpose(1, 0, 2)
    spread = covariance.copy()
    spread[:, :3, :3] += np.einsum('ijk,ajkmn,lmn->ail', cross, fourth, cross) / 4
    return spread
