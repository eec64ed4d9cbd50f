"""Small moves of a frame as a whole: a shift of a pivot and a turn about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pose import Pose

Field = NDArray[np.float64]


def move_about(error: Field, pivot: Field) -> Pose:
    """Pose that shifts a pivot and turns about it by an error (shift, turn)."""
    rotation = Rotation.from_rotvec(error[3:])
    return Pose(rotation, pivot - rotation.apply(pivot) + error[:3])


def about(lever: Field) -> Field:
    """How an error of a pose (shift, turn) moves a point at a lever from it, shape (3, 6)."""
    x, y, z = lever
    return np.hstack([np.eye(3), np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])])


def fit_in_space(
    ours: Field, theirs: Field, place: Field, pivot: Field, covariance: Field
) -> Pose:
    """Small turn and shift by least squares, with the pose's as a prior."""
    normal = np.linalg.inv(covariance + 1e-14 * np.eye(6))
    right = np.zeros(6)
    for here, there, spread in zip(ours, theirs, place, strict=True):
        jacobian = about(here - pivot) / spread
        normal += jacobian.T @ jacobian
        right += jacobian.T @ ((there - here) / spread)
    return move_about(np.linalg.solve(normal, right), pivot)
