"""The deepest place of a dent, how deep it is, and how sharp across."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.moments import Moments
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.skin.equations import solved

# Parts of the depth above which a quadric is fitted, the first that has cells enough.
_CAPS = 0.9, 0.8, 0.7, 0.6
_ENOUGH = 24
# Part of the depth that a good cap's is uncertain by at most, and the deepest cell's without one.
_GOOD = 0.02
# Part of what lies around a dent that is not measured, from which on it is cut.
_OPEN = 0.05
# Of the depth, for the radius at the bottom, and places along a profile to it.
_LEVEL = 0.8
_ALONG = np.linspace(0, 1, 120)
_UNIT = np.eye(6)

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Bottom:
    """The deepest place.

    Attributes
    ----------
    depth : float
        Metres.
    uncertainty : float
        By the noise and by the choice of the cap, metres.
    """

    depth: float
    uncertainty: float


def extent(
    patch: Patch, at: tuple[int, int], share: float, region: Mask | None = None
) -> tuple[float, float, bool]:
    """Length and width of what is deeper than a share of a cell's depth around it, metres.

    Those of the ellipse with the same second moments, and whether it leaves what is measured.
    """
    part = part_above(patch, at, share * patch.depth[at], region)
    moments = Moments.of(part)
    if moments.cells < 2:
        return patch.step, patch.step, False
    along, across = moments.ellipse(patch.step, patch.step)
    if patch.known.all():
        return along, across, False
    grown = cv2.dilate(part.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    around = grown & ~part
    return along, across, float(np.mean(~patch.known[around])) > _OPEN


def part_above(
    patch: Patch, at: tuple[int, int], level: float, region: Mask | None = None
) -> Mask:
    """What is connected with a cell and deeper than a level."""
    deep = (patch.depth > level) & patch.known
    if region is not None:
        deep &= region
    if not deep[at]:
        return np.zeros_like(deep)
    filled = deep.view(np.uint8)
    cv2.floodFill(filled, None, (at[1], at[0]), 2, flags=4)
    return filled == 2


def bottom_of(
    patch: Patch, at: tuple[int, int], noise: Vector, correlated: float, region: Mask | None
) -> Bottom:
    """Depth by a quadric through the cap around the deepest cell.

    Parameters
    ----------
    patch : Patch
    at : (int, int)
        The deepest cell.
    noise : ndarray, shape (rows, columns)
        Standard deviation of the patch's depths, metres.
    correlated : float
        Number of cells whose noise is one independent value.
    region : ndarray, shape (rows, columns), bool, optional
        Cells that are the dent's.
    """
    high = float(patch.depth[at])
    found: list[tuple[float, float]] = []
    for share in _CAPS:
        cap = part_above(patch, at, share * high, region)
        if np.count_nonzero(cap) < _ENOUGH:
            continue
        rows, columns = np.nonzero(cap)
        here = noise[rows, columns]
        usual = math.sqrt(float(here @ here) / len(here))
        found.append(_quadric(patch, rows, columns, at, usual, correlated))
        # Of two good caps the second tells what the choice makes.
        if len(found) == 2 or found[-1][1] > _GOOD * high:
            break
    if not found:
        return Bottom(high, math.hypot(noise[at], _GOOD * high))
    depth, spread = found[0]
    other = found[-1][0] if len(found) > 1 else depth
    return Bottom(depth, math.hypot(spread, depth - other))


def _quadric(patch, rows, columns, at, noise, correlated) -> tuple[float, float]:
    """Maximum of a quadric over the cells, and its standard deviation."""
    u, v = patch.step * (columns - at[1]), patch.step * (rows - at[0])
    scale = math.sqrt(float(u @ u + v @ v) / len(u))
    u, v = u / scale, v / scale
    basis = np.array([np.ones_like(u), u, v, u * u, u * v, v * v])
    normal = basis @ basis.T
    normal.flat[:: len(normal) + 1] += 1e-9 * normal.trace()
    inverse = solved(normal, _UNIT)
    solution = inverse @ (basis @ patch.depth[rows, columns])
    top = solution @ basis
    best = int(np.argmax(top))
    gain = float(basis[:, best] @ inverse @ basis[:, best])
    spread = noise * math.sqrt(min(gain * max(correlated, 1.0), 1.0))
    return float(top[best]), spread


def radius_across(
    patch: Patch, at: tuple[int, int], depth: float, angle: float, width: float
) -> float:
    """Radius of curvature at the bottom, of the parabola as wide at four fifths of the depth.

    Parameters
    ----------
    patch : Patch
    at : (int, int)
        The deepest cell.
    depth : float
        Metres.
    angle : float
        Of the width, from the patch's x axis, radians.
    width : float
        Metres.
    """
    along = 0.75 * width * _ALONG
    x, y = patch.x[at[1]], patch.y[at[0]]
    both = np.array([along, -along])
    reach = 0.0
    for depths in patch.at(x + both * math.cos(angle), y + both * math.sin(angle)):
        below = np.flatnonzero(depths < _LEVEL * depth)
        if not len(below) or not below[0]:
            reach += along[-1] if not len(below) else 0.0
            continue
        last = below[0] - 1
        part = (depths[last] - _LEVEL * depth) / max(depths[last] - depths[last + 1], 1e-15)
        reach += along[last] + part * (along[1] - along[0])
    return reach**2 / (8 * (1 - _LEVEL) * depth)
