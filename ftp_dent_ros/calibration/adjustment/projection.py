"""Pixels of points, and their derivatives by everything that they depend on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.adjustment.model import LENS


def project(points: NDArray, lens: NDArray):
    """Pixels, and their derivatives by the points (n, 2, 3) and the lens's numbers (n, 2, 9)."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = lens
    z = points[:, 2]
    x, y = points[:, 0] / z, points[:, 1] / z
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    pixel = np.stack([fx * xd + cx, fy * yd + cy], axis=1)
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    xx = fx * (radial + x * x * slope + 2 * p1 * y + 6 * p2 * x)
    yy = fy * (radial + y * y * slope + 6 * p1 * y + 2 * p2 * x)
    by_point = np.empty((len(z), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 1] = xx / z, fx * mixed / z
    by_point[:, 1, 0], by_point[:, 1, 1] = fy * mixed / z, yy / z
    by_point[:, :, 2] = -(by_point[:, :, 0] * x[:, None] + by_point[:, :, 1] * y[:, None])
    by_lens = np.zeros((len(z), 2, LENS))
    by_lens[:, 0, 0], by_lens[:, 1, 1] = xd, yd
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1
    for index, power in ((4, r2), (5, r2 * r2), (8, r2**3)):
        by_lens[:, 0, index], by_lens[:, 1, index] = fx * x * power, fy * y * power
    by_lens[:, 0, 6], by_lens[:, 1, 6] = 2 * fx * x * y, fy * (r2 + 2 * y * y)
    by_lens[:, 0, 7], by_lens[:, 1, 7] = fx * (r2 + 2 * x * x), 2 * fy * x * y
    return pixel, by_point, by_lens


def cross_matrices(vectors: NDArray) -> NDArray[np.float64]:
    """Matrices of the cross product with vectors of shape (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrices[:, 0, 1], matrices[:, 0, 2] = -z, y
    matrices[:, 1, 0], matrices[:, 1, 2] = z, -x
    matrices[:, 2, 0], matrices[:, 2, 1] = -y, x
    return matrices


def left_jacobian(rotation: NDArray) -> NDArray[np.float64]:
    """Change of the turned frame with a rotation vector: the left Jacobian of SO(3)."""
    angle = float(np.linalg.norm(rotation))
    cross = cross_matrices(rotation[None])[0]
    if angle < 1e-5:
        return np.eye(3) + cross / 2
    first = (1 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * cross @ cross
