"""The undeformed contour of a panel: a smooth surface that dents do not bend."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.skin.robust_polynomial import basis, powers

# Square of the steepest slope that a sagitta is calculated of: a sphere ends at 1.
_STEEPEST = 0.9
# Terms of the second degree.
_QUADRIC = 6
# Points at once: few such arrays of single precision fit a core's cache; of fewer points, calls
# take longer than their work.
_STRIP = 30_000

Field = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Contour:
    """A height over a tangent plane, exact for planes, cylinders and spheres.

    ``w = c0 + c1 x + c2 y + 2 q / (1 + sqrt(1 - |grad q|^2)) + higher terms``, where q is the
    quadratic form of c3, c4, c5: the sagitta of a circle instead of a parabola's.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        Metres.
    axes : ndarray, shape (3, 3)
        Rows x, y along the skin and w inward.
    scale : float
        Metres; the polynomials are in x / scale and y / scale, in units of scale.
    coefficients : ndarray, shape (6,) or more
    covariance : ndarray
        Of the coefficients.
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    scale: float
    coefficients: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def local(self, points: NDArray) -> tuple[Field, Field, Field]:
        """Coordinates x, y and w of points, shape (..., 3)."""
        if points.ndim == 3 and points.dtype == np.float32:
            # An image: three times as fast, and its planes lie together.
            move = np.hstack([self.axes, -self.axes @ self.origin[:, None]])
            x, y, w = cv2.split(cv2.transform(points, move.astype(np.float32)))
            return np.asarray(x), np.asarray(y), np.asarray(w)
        axes = self.axes.astype(points.dtype)
        local = (points - self.origin.astype(points.dtype)) @ axes.T
        return local[..., 0], local[..., 1], local[..., 2]

    def height(self, x: Field, y: Field) -> Field:
        """Height w of the contour at x, y, metres."""
        return self.surface(x, y)[0]

    def surface(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height at x, y, metres, and its derivatives along them."""
        kind = x.dtype.type
        x, y = x / kind(self.scale), y / kind(self.scale)
        c = self.coefficients.astype(kind)
        along_x, along_y = 2 * c[3] * x + c[4] * y, c[4] * x + 2 * c[5] * y
        flat = np.sqrt(1 - np.minimum(along_x * along_x + along_y * along_y, kind(_STEEPEST)))
        w = c[0] + c[1] * x + c[2] * y + (along_x * x + along_y * y) / (1 + flat)
        along_x, along_y = c[1] + along_x / flat, c[2] + along_y / flat
        for c_n, (i, j) in zip(c[6:], powers(len(c))[6:], strict=True):
            w += c_n * x**i * y**j
            along_x += c_n * i * x ** max(i - 1, 0) * y**j
            along_y += c_n * j * x**i * y ** max(j - 1, 0)
        return w * kind(self.scale), along_x, along_y

    def deviation(self, points: NDArray) -> tuple[Field, Field, Field]:
        """Feet x, y of points (..., 3) on the contour, and their depth below it, metres."""
        x, y, w = self.local(points)
        height, along_x, along_y = self.surface(x, y)
        above = w - height
        square = 1 + along_x * along_x + along_y * along_y
        # One Newton step towards the foot; the rest is of the order of the curvature.
        step = above / square
        return x + step * along_x, y + step * along_y, above / np.sqrt(square)

    def depth(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth below the contour of an image of points, shape (rows, columns, 3), metres."""
        depth = np.empty(image.shape[:2], np.float32)
        # In strips whose temporary arrays stay in the cache.
        rows = max(1, _STRIP // max(image.shape[1], 1))
        for top in range(0, len(image), rows):
            x, y, w = self.local(image[top : top + rows])
            height, along_x, along_y = self.surface(x, y)
            square = 1 + along_x * along_x + along_y * along_y
            depth[top : top + rows] = (w - height) / np.sqrt(square)
        return depth

    def point(self, x: Field, y: Field, depth: Field | float = 0.0) -> NDArray[np.float64]:
        """Points, shape (..., 3), that lie `depth` below the contour's x, y."""
        foot, outward = self.foot(x, y)
        return foot - np.asarray(depth)[..., None] * outward

    def normal(self, x: Field, y: Field) -> NDArray[np.float64]:
        """Unit normals outward, shape (..., 3)."""
        return self.foot(x, y)[1]

    def foot(self, x: Field, y: Field) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points on the contour and unit normals outward at x, y, each of shape (..., 3)."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        height, along_x, along_y = self.surface(x, y)
        length = np.sqrt(1 + along_x * along_x + along_y * along_y)
        local, outward = np.empty((2, *x.shape, 3))
        local[..., 0], local[..., 1], local[..., 2] = x, y, height
        outward[..., 0], outward[..., 1], outward[..., 2] = along_x, along_y, -1
        return self.origin + local @ self.axes, (outward / length[..., None]) @ self.axes

    def uncertainty(self, x: Field, y: Field) -> Field:
        """Standard uncertainty of the height at x, y, metres."""
        columns = basis(x / self.scale, y / self.scale, self.terms)
        square = ((columns @ self.covariance) * columns).sum(axis=-1)
        return self.scale * np.sqrt(np.maximum(square, 0))

    @property
    def is_rich(self) -> bool:
        """Whether its degree is more than the second."""
        return self.terms > _QUADRIC

    @property
    def terms(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)
