"""The contour of a dent at a level of its depth, and its length and width."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.moments import Moments
from ftp_dent_ros.inspection.measuring.patch import Mask, Patch

_RAYS, _SAMPLES = 48, 96
# Along each, in radii of the ellipse with the same moments.
_ALONG = np.linspace(0, 2.2, _SAMPLES)
# Harmonics of the outline about its ellipse: at most, and at least; all of them where the level
# is so many standard deviations of the noise.
_HARMONICS, _FEWEST, _CLEAR = 8, 2, 10.0
# Standard deviations of the noise that a level is above zero at least for an outline to be drawn
# there, and the part of the depth that such a level is at most.
_ABOVE, _HIGHEST = 2.0, 0.5
#: Part of an outline, or of what lies beside it, that is not measured and makes it a cut one.
CUT = 0.05

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed curve on the contour's x, y.

    Attributes
    ----------
    x, y : ndarray, shape (n,)
        Metres.
    inside : ndarray, shape (rows, columns), bool
        Cells of the patch that lie within.
    is_cut : bool
        Whether it leaves what is measured.
    carried : float
        Standard uncertainty of its sizes, as a part of them, by being drawn at another level.
    """

    x: Vector
    y: Vector
    inside: Mask
    is_cut: bool
    carried: float

    @cached_property
    def centre(self) -> tuple[float, float]:
        """Centroid of the area, metres."""
        x, y, cross = self._edges
        six = 3 * cross.sum()
        return float((self.x + x) @ cross / six), float((self.y + y) @ cross / six)

    @cached_property
    def area(self) -> float:
        """Square metres."""
        return abs(float(self._edges[2].sum() / 2))

    @cached_property
    def length(self) -> tuple[float, float]:
        """Longest distance between two points, and its angle."""
        apart = (self.x[:, None] - self.x) ** 2 + (self.y[:, None] - self.y) ** 2
        i, j = np.unravel_index(np.argmax(apart), apart.shape)
        return math.sqrt(apart[i, j]), math.atan2(self.y[j] - self.y[i], self.x[j] - self.x[i])

    @cached_property
    def width(self) -> float:
        """Extent at 90 degrees to the length."""
        angle = self.length[1]
        return float(np.ptp(math.cos(angle) * self.y - math.sin(angle) * self.x))

    @cached_property
    def axis(self) -> float:
        """Angle of the longer principal axis of the area."""
        x, y = self.centre
        a, b, u, v = self.x - x, self.y - y, self._edges[0] - x, self._edges[1] - y
        cross = a * v - u * b
        xx, yy = (cross @ (p * p + p * q + q * q) for p, q in ((a, u), (b, v)))
        xy = cross @ (a * v + 2 * a * b + 2 * u * v + u * b) / 2
        sign = math.copysign(1, cross.sum())
        return math.atan2(2 * sign * xy, sign * (xx - yy)) / 2

    @cached_property
    def _edges(self) -> tuple[Vector, Vector, Vector]:
        """For each point the next one, and the cross product of both."""
        x, y = np.roll(self.x, -1), np.roll(self.y, -1)
        return x, y, self.x * y - x * self.y


def part_above(patch: Patch, at: tuple[int, int], level: float, region: Mask | None) -> Mask:
    """What is connected with a cell and deeper than a level."""
    deep = (patch.depth > level) & patch.known
    if region is not None:
        deep &= region
    if not deep[at]:
        return np.zeros_like(deep)
    filled = deep.view(np.uint8)
    cv2.floodFill(filled, None, (at[1], at[0]), 2, flags=4)
    return filled == 2


def find_outline(
    patch: Patch, at: tuple[int, int], depth: float, wanted: float, region: Mask | None
) -> Outline | None:
    """Outline at a part of the depth around a cell; None if there is none.

    Where noise would draw it, it is drawn where the depth stands out and carried on by as much as
    the flanks of anything between a paraboloid and a Gaussian go on, which is a part of its sizes
    that they are unsure by.

    Parameters
    ----------
    patch : Patch
    at : (int, int)
        Row and column of the deepest cell.
    depth : float
        There, metres.
    wanted : float
        Part of the depth whose outline is asked for.
    region : ndarray, shape (rows, columns), bool, optional
        Cells that it lies within.
    """
    noise = float(patch.strays[at])
    level = min(max(wanted, _ABOVE * noise / depth), _HIGHEST)
    part = _closed(part_above(patch, at, level * depth, region))
    moments = Moments.of(part)
    if moments.cells < 9:
        return None
    least, most = 1.0, 1.0
    if level > wanted:
        least = math.sqrt((1 - wanted) / (1 - level))
        most = math.sqrt(math.log(wanted) / math.log(level))
    middle = (least + most) / 2
    (long, wide), angle = moments.ellipse(), moments.angle
    c, s = math.cos(angle), math.sin(angle)
    # From the unit circle to the ellipse.
    stretch = np.array([[-wide * s, long * c], [wide * c, long * s]]) / 2
    ray = (stretch @ _circle(_RAYS))[..., None] * _ALONG
    columns, rows = moments.column + ray[0], moments.row + ray[1]
    depths = patch.at(patch.depth, columns, rows)
    # One cell more, so that the crossing behind the last cell is seen.
    wider = np.asarray(cv2.dilate(part.view(np.uint8), np.ones((3, 3), np.uint8)))
    held = (patch.at(wider, columns, rows, cv2.INTER_NEAREST) > 0.5) & (depths > level * depth)
    held[:, 0] = True
    last = np.minimum(_SAMPLES - 1 - np.argmax(held[:, ::-1], axis=1), _SAMPLES - 2)
    each = np.arange(_RAYS)
    high, low = depths[each, last], depths[each, last + 1]
    beyond = (high - level * depth) / np.maximum(high - low, 1e-12)
    crossing = _ALONG[last] + _ALONG[1] * np.clip(beyond, 0, 1)
    # The nearer the noise comes to the level, the smoother a curve: a ragged one is too long.
    clear = level * depth / max(noise, 1e-12) / _CLEAR
    spectrum = np.fft.rfft(crossing)
    spectrum[int(min(max(_HARMONICS * clear, _FEWEST), _HARMONICS)) + 1 :] = 0
    out = np.array([[moments.column], [moments.row]])
    # Twice as many points as rays: a polygon is smaller than its curve.
    radius = 2 * np.fft.irfft(spectrum, 2 * _RAYS)
    out = out + middle * radius * (stretch @ _circle(2 * _RAYS))
    column, row = np.clip(out, 0, [[each - 1] for each in part.shape[::-1]])
    x, y = (patch.at(each, column, row, cv2.INTER_LINEAR) for each in (patch.x, patch.y))
    # A range is its half over the root of three uncertain.
    carried = (most - least) / 2 / math.sqrt(3) / middle
    inside = _covered(part.shape, column, row)
    return Outline(x, y, inside, _is_cut(patch, column, row), carried)


@cache
def _circle(count: int) -> NDArray[np.float64]:
    """Points of the unit circle, evenly spread, shape (2, count)."""
    angles = np.arange(count) * 2 * math.pi / count
    return np.stack([np.cos(angles), np.sin(angles)])


def _covered(shape: tuple[int, ...], columns: Vector, rows: Vector) -> Mask:
    """Cells within a polygon."""
    inside = np.zeros(shape, np.uint8)
    corners = np.rint(16 * np.stack([columns, rows], axis=1)).astype(np.int32)
    return np.asarray(cv2.fillPoly(inside, [corners], 1, shift=4)) > 0


def _closed(part: Mask) -> Mask:
    """A part with its holes."""
    contours, _ = cv2.findContours(part.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = np.zeros(part.shape, np.uint8)
    return np.asarray(cv2.drawContours(whole, contours, -1, 1, cv2.FILLED)) > 0


def _is_cut(patch: Patch, columns: Vector, rows: Vector) -> bool:
    """Whether a part of the outline is not measured around."""
    near = np.ones((3, 3), np.uint8)
    inner = np.asarray(cv2.erode(patch.known.view(np.uint8), near, borderValue=0))
    return bool((patch.at(inner, columns, rows, cv2.INTER_NEAREST) < 0.5).mean() > CUT)
