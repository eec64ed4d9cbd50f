"""The contour of a dent at a level of its depth, and its length and width."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import COVERAGE
from ftp_dent_ros.inspection.measuring.patch import Mask, Patch, ellipse_of

_RAYS = 48
_SAMPLES = 2 * _RAYS
# Along each, in radii of the ellipse with the same moments.
_ALONG = np.linspace(0, 2.2, _SAMPLES)
# Harmonics of the outline about its ellipse at most.
_HARMONICS = 8
# Of the depth, the highest level that an outline is drawn at where noise would draw a lower one.
_HIGHEST = 0.5
#: Standard uncertainty of an angle between the points of an outline, radians.
BETWEEN = math.pi / _RAYS / math.sqrt(12)
#: Part of an outline, or of what lies beside it, that is not measured and makes it a cut one.
CUT = 0.05

Vector = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed curve on the contour's x, y.

    Attributes
    ----------
    x, y : ndarray, shape (n,), float32
        Metres.
    inside : ndarray, shape (rows, columns), bool
        Cells of the patch that lie within.
    unsure : float
        Standard uncertainty of its sizes, as a part of them, by being smoothed and carried on.
    """

    x: Vector
    y: Vector
    inside: Mask
    unsure: float

    @property
    def centre(self) -> tuple[float, float]:
        """Centroid of the area, metres."""
        area = self._moments['m00']
        return self._moments['m10'] / area, self._moments['m01'] / area

    @property
    def area(self) -> float:
        """Square metres."""
        return self._moments['m00']

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

    @property
    def axis(self) -> float:
        """Angle of the longer principal axis of the area."""
        found = self._moments
        return math.atan2(2 * found['mu11'], found['mu20'] - found['mu02']) / 2

    @cached_property
    def _moments(self) -> dict[str, float]:
        return dict(cv2.moments(np.stack([self.x, self.y], axis=1)))


def is_cut(patch: Patch, outline: Outline) -> bool:
    """Whether a part of an outline is not measured around."""
    near = np.ones((3, 3), np.uint8)
    within, known = (
        cv2.erode(each.view(np.uint8), near, borderValue=0) > 0
        for each in (outline.inside, patch.known)
    )
    return float(known[outline.inside & ~within].mean()) < 1 - CUT


def part_above(patch: Patch, at: tuple[int, int], level: float) -> Mask:
    """What is connected with a cell and deeper than a level."""
    deep = (patch.depth > level) & patch.known
    if not deep[at]:
        return np.zeros_like(deep)
    filled = deep.view(np.uint8)
    cv2.floodFill(filled, None, (at[1], at[0]), 2, flags=4)
    return filled == 2


def find_outline(patch: Patch, at: tuple[int, int], depth: float, wanted: float) -> Outline | None:
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
    """
    level = min(max(wanted, COVERAGE * float(patch.strays[at]) / depth), _HIGHEST)
    part = closed(part_above(patch, at, level * depth))
    if not part.any():
        return None
    least = math.sqrt((1 - wanted) / (1 - level))
    most = math.sqrt(math.log(wanted) / math.log(level))
    middle = (least + most) / 2
    centre, stretch = ellipse_of(part)
    columns, rows = centre[..., None] + (stretch @ _circle(_RAYS))[..., None] * _ALONG
    depths = patch.at(patch.depth, columns, rows)
    # One cell more, so that the crossing behind the last cell is seen.
    wider = np.asarray(cv2.dilate(part.view(np.uint8), np.ones((3, 3), np.uint8)))
    held = (patch.at(wider, columns, rows, cv2.INTER_NEAREST) > 0) & (depths > level * depth)
    held[:, 0] = True
    last = np.minimum(_SAMPLES - 1 - np.argmax(held[:, ::-1], axis=1), _SAMPLES - 2)
    each = np.arange(_RAYS)
    high, low = depths[each, last], depths[each, last + 1]
    beyond = (high - level * depth) / np.maximum(high - low, 1e-12)
    crossing = _ALONG[last] + _ALONG[1] * np.clip(beyond, 0, 1)
    # As many harmonics as the level is standard uncertainties of the depths, and two at least: a
    # ragged curve is too long.
    unsure = float(patch.unsure[part].mean())
    few = 1 + int(min(max(level * depth / max(unsure, 1e-12), 2), _HARMONICS))
    spectrum = np.fft.rfft(crossing)
    # What they leave out may be its shape; a diameter has two independent ends.
    left_out = float(np.linalg.norm(spectrum[few : _HARMONICS + 1]) / abs(spectrum[0]))
    spectrum[few:] = 0
    # Twice as many points as rays: a polygon is smaller than its curve.
    radius = 2 * np.fft.irfft(spectrum, 2 * _RAYS)
    out = centre + middle * radius * (stretch @ _circle(2 * _RAYS))
    column, row = np.clip(out, 0, [[each - 1] for each in part.shape[::-1]])
    x, y = (patch.at(each, column, row, cv2.INTER_LINEAR) for each in (patch.x, patch.y))
    # A range is its half over the root of three uncertain.
    carried = (most - least) / 2 / math.sqrt(3) / middle
    return Outline(x, y, _covered(part.shape, column, row), math.hypot(carried, left_out))


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


def closed(part: Mask) -> Mask:
    """A part with what it goes around."""
    contours, _ = cv2.findContours(part.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    whole = np.zeros(part.shape, np.uint8)
    return np.asarray(cv2.drawContours(whole, contours, -1, 1, cv2.FILLED)) > 0
