"""A lens: rays to pixels and back, of a camera as of a projector.

Pixels follow OpenCV: an integer coordinate is a pixel's centre, on the projector too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Far below what a calibration knows.
_UNDISTORTED = 1e-12


@dataclass(frozen=True, eq=False)
class Lens:
    """Pinhole model with Brown-Conrady distortion (``plumb_bob`` of sensor_msgs/CameraInfo).

    Attributes
    ----------
    width, height : int
        Image size, pixels.
    camera_matrix : ndarray, shape (3, 3)
        ``[[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]``, pixels.
    distortion : ndarray, shape (5,)
        ``k1, k2, p1, p2, k3``.
    """

    width: int
    height: int
    camera_matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]

    @property
    def transposed(self) -> Lens:
        """The same lens with columns for rows, and rows for columns."""
        matrix = self.camera_matrix[[1, 0, 2]][:, [1, 0, 2]]
        return Lens(self.height, self.width, matrix, self.distortion[[0, 1, 3, 2, 4]])

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Project points of shape (..., 3) in this lens's frame to pixels, shape (..., 2)."""
        points = np.asarray(points, float)
        ideal = points[..., :2] / points[..., 2:]
        distorted, _ = self._distort(ideal)
        focal = self.camera_matrix[[0, 1], [0, 1]]
        return focal * distorted + self.camera_matrix[:2, 2]

    def rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Undistorted rays of shape (..., 3), z = 1, through pixels of shape (..., 2)."""
        focal = self.camera_matrix[[0, 1], [0, 1]]
        distorted = (np.asarray(pixels, float) - self.camera_matrix[:2, 2]) / focal
        ideal = distorted.copy()
        for _ in range(20 if self.distortion.any() else 0):
            image, jacobian = self._distort(ideal)
            # By hand, not LAPACK: the same bits on every machine, for those who send depths alone.
            ((a, b), (c, d)), (x, y) = (
                np.moveaxis(jacobian, (-2, -1), (0, 1)),
                np.moveaxis(distorted - image, -1, 0),
            )
            step = np.stack([d * x - b * y, a * y - c * x], axis=-1) / (a * d - b * c)[..., None]
            ideal += step
            if np.abs(step).max(initial=0.0) < _UNDISTORTED:
                break
        return np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)

    def pixel_grid(self, stride: int = 1) -> NDArray[np.float64]:
        """Centres (u, v) of every `stride`-th pixel, shape (rows, columns, 2)."""
        u, v = np.meshgrid(np.arange(0, self.width, stride), np.arange(0, self.height, stride))
        return np.stack([u, v], axis=-1).astype(float)

    def _distort(self, ideal: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distorted coordinates of shape (..., 2) and their Jacobian of shape (..., 2, 2)."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = ideal[..., 0], ideal[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
        distorted = np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
        jacobian = np.stack(
            [
                radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
                mixed,
                mixed,
                radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
            ],
            axis=-1,
        ).reshape(*ideal.shape[:-1], 2, 2)
        return distorted, jacobian
