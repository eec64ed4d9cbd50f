"""The contour of a dent at a level of its depth, and its length and width."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.moments import Moments
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch, sampled
from ftp_dent_ros.inspection.measuring.outlines.peak import part_above

_RAYS = 96
_SAMPLES = 80
# Along each, in radii of the ellipse with the same moments.
_ALONG = np.linspace(0, 2.2, _SAMPLES)
# Of the outline about its ellipse: at most, and at least; all of them where the level is so many
# standard deviations of the noise.
_HARMONICS, _FEWEST, _CLEAR = 8, 2, 10.0
_POINTS = 120
# Parts of a cell's side, for areas.
_FINE = 4

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed curve on the contour's x, y.

    Attributes
    ----------
    x, y : ndarray, shape (n,)
        Metres.
    slope : ndarray, shape (n,)
        How fast the depth falls across it.
    inside : ndarray, shape (rows, columns)
        Part of each cell of the patch that lies within.
    is_cut : bool
        Whether it leaves what is measured.
    """

    x: Vector
    y: Vector
    slope: Vector
    inside: Vector
    is_cut: bool

    @cached_property
    def centre(self) -> tuple[float, float]:
        """Centroid of the area, metres."""
        (next_x, next_y), cross = self._next, self._cross
        six = 3 * cross.sum()
        return (
            float((self.x + next_x) @ cross / six),
            float((self.y + next_y) @ cross / six),
        )

    @cached_property
    def area(self) -> float:
        """Square metres."""
        return abs(float(self._cross.sum() / 2))

    def carried_on(self, patch: Patch, factor: float) -> Outline:
        """The curve `factor` times as far from its centre, as that of a lower level lies."""
        x, y = self.centre
        out_x, out_y = x + factor * (self.x - x), y + factor * (self.y - y)
        at_x, at_y = patch.cells(out_x, out_y)
        inside, cut = _covered(patch.depth.shape, at_x, at_y), _cut(patch, at_x, at_y)
        return Outline(out_x, out_y, self.slope / factor, inside, cut)

    @property
    def perimeter(self) -> float:
        """Metres."""
        next_x, next_y = self._next
        return float(np.hypot(next_x - self.x, next_y - self.y).sum())

    def axis(self) -> float:
        """Angle of the longer principal axis of the area."""
        x, y = self.centre
        a, b = self.x - x, self.y - y
        u, v = self._next[0] - x, self._next[1] - y
        cross = a * v - u * b
        xx = cross @ (a * a + a * u + u * u)
        yy = cross @ (b * b + b * v + v * v)
        xy = cross @ (a * v + 2 * a * b + 2 * u * v + u * b) / 2
        sign = math.copysign(1, cross.sum())
        return math.atan2(2 * sign * xy, sign * (xx - yy)) / 2

    def length(self) -> tuple[float, float, list[int]]:
        """Longest distance between two points, its angle, and which they are."""
        apart = (self.x[:, None] - self.x) ** 2 + (self.y[:, None] - self.y) ** 2
        i, j = np.unravel_index(np.argmax(apart), apart.shape)
        angle = math.atan2(self.y[j] - self.y[i], self.x[j] - self.x[i])
        return math.sqrt(apart[i, j]), angle, [int(i), int(j)]

    def width(self, angle: float) -> tuple[float, list[int]]:
        """Extent at 90 degrees to an angle, and the points at its ends."""
        across = math.cos(angle) * self.y - math.sin(angle) * self.x
        i, j = int(np.argmax(across)), int(np.argmin(across))
        return float(across[i] - across[j]), [i, j]

    @cached_property
    def _next(self) -> tuple[Vector, Vector]:
        """For each point, the next one along the curve."""
        return np.concatenate([self.x[1:], self.x[:1]]), np.concatenate([self.y[1:], self.y[:1]])

    @cached_property
    def _cross(self) -> Vector:
        next_x, next_y = self._next
        return self.x * next_y - next_x * self.y


def find_outline(
    patch: Patch,
    peak: tuple[int, int],
    level: float,
    region: Mask | None = None,
    noise: float = 0.0,
) -> Outline | None:
    """Outline of the part of a patch that holds a cell and is deeper than `level`, if any.

    Parameters
    ----------
    patch : Patch
    peak : (int, int)
        Row and column of the cell.
    level : float
        Metres.
    region : ndarray, shape (rows, columns), bool, optional
        Cells that it lies within.
    noise : float
        Standard deviation of the depths, metres: the nearer it comes to the level, the smoother
        a curve is drawn, for the longest distance of a ragged one is too long.
    """
    filled = _filled(part_above(patch, peak, level, region))
    moments = Moments.of(filled)
    if moments.cells < 9:
        return None
    column, row = moments.column, moments.row
    (length, width), angle = moments.ellipse(), moments.angle
    c, s = math.cos(angle), math.sin(angle)
    # From the unit circle to the ellipse.
    stretch = np.array([[-width * s, length * c], [width * c, length * s]]) / 2
    ray = stretch @ _circle(_RAYS)
    at_x = column + ray[0][:, None] * _ALONG
    at_y = row + ray[1][:, None] * _ALONG
    depth = sampled(patch.single, at_x, at_y, cv2.INTER_CUBIC)
    # One cell more, so that the crossing behind the last cell is seen.
    wider = cv2.dilate(filled.view(np.uint8), np.ones((3, 3), np.uint8))
    held = (sampled(wider, at_x, at_y, cv2.INTER_NEAREST) > 0.5) & (depth > level)
    held[:, 0] = True
    last = np.minimum(_SAMPLES - 1 - np.argmax(held[:, ::-1], axis=1), _SAMPLES - 2)
    each = np.arange(_RAYS)
    high, low = depth[each, last], depth[each, last + 1]
    fall = np.maximum(high - low, 1e-12)
    crossing = _ALONG[last] + _ALONG[1] * np.clip((high - level) / fall, 0, 1)
    dense = _harmonic(crossing, _POINTS, _kept(level, noise))
    ray = stretch @ _circle(_POINTS)
    out_x, out_y = column + dense * ray[0], row + dense * ray[1]
    cut = _cut(patch, out_x, out_y)
    slope = _slope(patch, out_x, out_y, level)
    return Outline(
        patch.corner[0] + patch.step * out_x,
        patch.corner[1] + patch.step * out_y,
        slope,
        _covered(patch.depth.shape, out_x, out_y),
        cut,
    )


@cache
def _circle(count: int) -> NDArray[np.float64]:
    """Points of the unit circle, evenly spread, shape (2, count)."""
    angles = np.arange(count) * 2 * math.pi / count
    return np.stack([np.cos(angles), np.sin(angles)])


def _covered(shape: tuple[int, ...], columns: Vector, rows: Vector) -> Vector:
    """Part of each cell within a polygon."""
    fine = np.zeros((_FINE * shape[0], _FINE * shape[1]), np.uint8)
    corners = _FINE * (np.stack([columns, rows], axis=1) + 0.5) - 0.5
    cv2.fillPoly(fine, [np.rint(16 * corners).astype(np.int32)], 1, shift=4)
    return cv2.resize(fine.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA).astype(
        float
    )


def _filled(part: Mask) -> Mask:
    contours, _ = cv2.findContours(part.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(part.shape, np.uint8)
    cv2.drawContours(filled, contours, -1, 1, cv2.FILLED)
    return filled > 0


def _kept(level: float, noise: float) -> int:
    """Number of harmonics whose noise stays well below what the level can tell."""
    clear = level / max(noise, 1e-12) / _CLEAR
    return int(min(max(_HARMONICS * clear, _FEWEST), _HARMONICS))


def _harmonic(values: Vector, count: int, harmonics: int) -> Vector:
    """The lowest harmonics of a periodic sequence, at `count` places."""
    spectrum = np.fft.rfft(values)[: harmonics + 1]
    padded = np.zeros(count // 2 + 1, complex)
    padded[: len(spectrum)] = spectrum
    return np.fft.irfft(padded, count) * (count / len(values))


def _slope(patch: Patch, at_x: Vector, at_y: Vector, level: float) -> Vector:
    # Right, left, below and above.
    columns = np.stack([at_x + 1, at_x - 1, at_x, at_x])
    rows = np.stack([at_y, at_y, at_y + 1, at_y - 1])
    right, left, below, above = sampled(patch.single, columns, rows, cv2.INTER_LINEAR)
    steep = np.hypot(right - left, below - above) / (2 * patch.step)
    return np.maximum(steep, level / (50 * patch.step))


def _cut(patch: Patch, at_x: Vector, at_y: Vector) -> bool:
    """Whether more than a twentieth of the outline is not measured around."""
    size = 2 * math.ceil(patch.scale / patch.step) + 1
    inner = cv2.erode(
        patch.known.view(np.uint8),
        np.ones((size, size), np.uint8),
        borderType=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    known = sampled(inner, at_x, at_y, cv2.INTER_NEAREST) > 0.5
    return bool((~known).mean() > 0.05)
