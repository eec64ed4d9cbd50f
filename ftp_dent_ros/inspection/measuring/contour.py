"""The undeformed contour of a skin: a smooth surface that dents do not bend."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.lattice import FEW
from ftp_dent_ros.robust import median

# Tukey's biweight: its efficiency is 95 % at this many standard deviations.
TUKEY = 4.7
# Square of the steepest slope that a sagitta is calculated of: a sphere ends at 1.
_STEEPEST = 0.9
# Mean residual, in full widths of the biweight, of a fit that most of the points agree on.
_AGREED = 0.3

Field = NDArray[np.floating]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Contour:
    """A height over a tangent plane, exact for planes, cylinders and spheres.

    ``w = c0 + c1 x + c2 y + 2 q / (1 + sqrt(1 - |grad q|^2))``, where q is the quadratic form of
    c3, c4, c5: the sagitta of a circle instead of a parabola's.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        Metres.
    axes : ndarray, shape (3, 3)
        Rows x, y along the skin and w inward.
    scale : float
        Metres; the polynomials are in x / scale and y / scale, in units of scale.
    coefficients : ndarray, shape (6,)
    covariance : ndarray, shape (6, 6)
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
        local = (points - self.origin) @ self.axes.T
        return local[..., 0], local[..., 1], local[..., 2]

    def surface(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height w at x, y, metres, and its derivatives along them."""
        kind = x.dtype.type
        x, y = x / kind(self.scale), y / kind(self.scale)
        c = self.coefficients.astype(kind)
        along_x, along_y, flat = _gradient(c, x, y)
        w = c[0] + c[1] * x + c[2] * y + (along_x * x + along_y * y) / (1 + flat)
        return w * kind(self.scale), c[1] + along_x / flat, c[2] + along_y / flat

    def deviation(self, points: NDArray) -> tuple[Field, Field, Field]:
        """Feet x, y of points (..., 3) on the contour, and their depth below it, metres."""
        x, y, w = self.local(points)
        height, along_x, along_y = self.surface(x, y)
        above, square = w - height, 1 + along_x * along_x + along_y * along_y
        # One Newton step towards the foot; the rest is of the order of the curvature.
        step = above / square
        return x + step * along_x, y + step * along_y, above / np.sqrt(square)

    def depth(self, points: NDArray) -> Field:
        """Depth of points, shape (..., 3), below the contour, metres."""
        x, y, w = self.local(points)
        height, along_x, along_y = self.surface(x, y)
        return (w - height) / np.sqrt(1 + along_x * along_x + along_y * along_y)

    def foot(self, x: Field, y: Field) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points on the contour and unit normals outward at x, y, each of shape (..., 3)."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        height, along_x, along_y = self.surface(x, y)
        outward = np.stack([along_x, along_y, -np.ones_like(x)], axis=-1)
        outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
        local = np.stack([x, y, height], axis=-1)
        return self.origin + local @ self.axes, outward @ self.axes

    def uncertainty(self, x: float, y: float) -> float:
        """Standard uncertainty of the height at x, y, metres."""
        (terms,) = _terms(np.array([x]) / self.scale, np.array([y]) / self.scale)
        return self.scale * math.sqrt(max(float(terms @ self.covariance @ terms), 0.0))


def fit_contour(
    points: NDArray, viewpoint: NDArray[np.float64], noise: float, rng: np.random.Generator
) -> Contour:
    """Contour that most of the points agree on, the others left out.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    viewpoint : ndarray, shape (3,)
        Of the camera, on the outer side.
    noise : float
        Standard deviation that points of the skin have, metres.
    rng : numpy.random.Generator
        Draws the points that are looked at, of many.
    """
    points = _some(points, FEW, rng)
    contour = _plane(points, viewpoint)
    samples = _Samples(contour, points, noise)
    whole, *halves = samples.starts()
    fits = [samples.fitted(whole)]
    if fits[0][0] > _AGREED:
        fits += [samples.fitted(half) for half in halves]
    best = min(fits, key=lambda fit: fit[0])[1]
    for _ in range(2):
        # Again over the plane that is tangent to it: the sagitta is about its foot.
        contour = _tangent(replace(contour, coefficients=best))
        best = _Samples(contour, points, noise).narrowed(contour.coefficients, 2 * noise)
    return replace(contour, coefficients=best)


def refined(contour: Contour, points: NDArray, noise: float) -> Contour:
    """The contour fitted again to points of the bare skin, shape (n, 3), with its covariance.

    Parameters
    ----------
    contour : Contour
    points : ndarray, shape (n, 3)
    noise : float
        Their standard deviation, metres.
    """
    samples = _Samples(contour, points, noise)
    coefficients = samples.narrowed(contour.coefficients, 2 * noise)
    left = samples.left(coefficients)
    weight = biweight(left / samples.width)
    variance = (weight * left * left).sum() / max(weight.sum() - len(coefficients), 1.0)
    inverse = np.linalg.pinv(samples.terms.T @ (samples.terms * weight[:, None]))
    return replace(contour, coefficients=coefficients, covariance=variance * inverse)


class _Samples:
    """Points of which some lie on dents, or on other parts, in units of the contour's scale."""

    def __init__(self, contour: Contour, points: NDArray, noise: float) -> None:
        self.x, self.y, self._w = (each / contour.scale for each in contour.local(points))
        self.terms = _terms(self.x, self.y)
        self._scale = contour.scale
        self.width = TUKEY * noise / contour.scale

    def left(self, c: NDArray[np.float64]) -> Field:
        """What coefficients leave: the sagitta is in place of the second degree."""
        along_x, along_y, flat = _gradient(c, self.x, self.y)
        sagitta = (along_x * self.x + along_y * self.y) / (1 + flat)
        return self._w - self.terms[:, :3] @ c[:3] - sagitta

    def starts(self) -> Iterator[Mask]:
        """All of the points, and each half of them."""
        yield np.ones(len(self.x), bool)
        for along in (self.x, self.y):
            upper = along > np.median(along)
            yield upper
            yield ~upper

    def fitted(self, start: Mask) -> tuple[float, NDArray[np.float64]]:
        """Cost and coefficients of a fit that starts from some points and narrows down."""
        found = self._improved(np.zeros(6), start.astype(float))
        for _ in range(3):
            # Least absolute deviations first: the biweight would drop points for good.
            size = np.abs(self.left(found))
            weight = start / np.maximum(size, max(size.mean() / 2, 1e-12))
            found = self._improved(found, weight)
        width = 1.5 * self._scale * float(np.median(np.abs(self.left(found)[start])))
        found = self.narrowed(found, width)
        return float(np.minimum(np.abs(self.left(found)) / self.width, 1).mean()), found

    def narrowed(self, found: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
        """Coefficients by biweights that halve from a standard deviation to the noise's."""
        width = max(TUKEY * spread / self._scale, self.width)
        while True:
            for _ in range(2):
                found = self._improved(found, biweight(self.left(found) / width))
            if width == self.width:
                return found
            width = max(width / 2, self.width)

    def _improved(self, found: NDArray[np.float64], weight: Field) -> NDArray[np.float64]:
        """One step of weighted least squares; none where fewer points bear weight than 6."""
        if np.count_nonzero(weight) < len(found):
            return found
        weighted = self.terms * weight[:, None]
        normal = weighted.T @ self.terms
        normal.flat[:: len(normal) + 1] += 1e-9 * normal.trace()
        return found + np.linalg.solve(normal, weighted.T @ self.left(found))


def _terms(x: Field, y: Field) -> NDArray[np.float64]:
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).astype(float)


def _gradient(c: Field, x: Field, y: Field) -> tuple[Field, Field, Field]:
    """Slopes of the quadratic form at x, y, and the cosine of the sphere's turn there."""
    along_x, along_y = 2 * c[3] * x + c[4] * y, c[4] * x + 2 * c[5] * y
    square = along_x * along_x + along_y * along_y
    return along_x, along_y, np.sqrt(1 - np.minimum(square, x.dtype.type(_STEEPEST)))


def biweight(ratio: Field) -> Field:
    """Weight of Tukey's biweight, 0 from a ratio of 1 on."""
    return np.square(1 - np.minimum(ratio * ratio, 1))


def _some(points: NDArray, count: int, rng: np.random.Generator) -> NDArray:
    """About `count` of the points, spread evenly."""
    if len(points) > count:
        points = points[rng.choice(len(points), count, replace=False)]
    return points.astype(float)


def _plane(points: NDArray, viewpoint: NDArray[np.float64]) -> Contour:
    """Frame of the principal axes, w away from the viewpoint."""
    origin = np.array([median(axis) for axis in points.T])
    centred = points - origin
    _, axes = np.linalg.eigh(centred.T @ centred)
    inward = axes[:, 0] * (1 if axes[:, 0] @ (origin - viewpoint) > 0 else -1)
    frame = np.stack([axes[:, 2], np.cross(inward, axes[:, 2]), inward])
    return Contour(origin, frame, float(np.abs(centred).max()), np.zeros(6), np.zeros((6, 6)))


def _tangent(contour: Contour) -> Contour:
    """The same contour over its tangent plane at the origin, to first order."""
    origin, outward = contour.foot(np.float64(0), np.float64(0))
    along = contour.axes[0] + outward * (contour.axes[0] @ -outward)
    along /= np.linalg.norm(along)
    frame = np.stack([along, np.cross(-outward, along), -outward])
    coefficients = contour.coefficients.copy()
    coefficients[:3] = 0
    return replace(contour, origin=origin, axes=frame, coefficients=coefficients)
