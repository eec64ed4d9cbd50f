"""Sizes of one dent, and how uncertain they are: by measuring it again with other noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.inspection.measuring.lattice import LEVEL
from ftp_dent_ros.inspection.measuring.noise import SURE
from ftp_dent_ros.inspection.measuring.outline import (
    BETWEEN,
    Outline,
    find_outline,
    is_cut,
    part_above,
)
from ftp_dent_ros.inspection.measuring.patch import Mask, Patch
from ftp_dent_ros.inspection.measuring.skin import Skin

# Fields of noise that a dent is measured again with, and how much wider so few make an interval
# of 95 %.
_FIELDS = 4
_WIDER = stdtrit(_FIELDS, 0.975) / ndtri(0.975)
#: Part of the depth above which the bottom is.
CAP = 0.85
# Places across the bottom, in widths.
_ACROSS = np.linspace(-0.75, 0.75, 301)


@dataclass(frozen=True, eq=False)
class Sizes:
    """What is measured of one dent.

    Attributes
    ----------
    outline : Outline
        At `LEVEL`.
    angle : Estimate
        Of the length, from the patch's x axis, radians.
    depth, length, width, area, volume : Estimate
        Metres, square and cubic metres, inward positive.
    radius : float
        Of curvature at the bottom across the length, metres; NaN if it is not measured there.
    slender : float
        Length over width at half of the depth, which noise does not draw out.
    is_cut : bool
        Whether the outline leaves what is measured.
    hidden : float
        Part of the area that was not measured.
    shown : float
        Largest depth that was measured, metres.
    """

    outline: Outline
    angle: Estimate
    depth: Estimate
    length: Estimate
    width: Estimate
    area: Estimate
    volume: Estimate
    radius: float
    slender: float
    is_cut: bool
    hidden: float
    shown: float


def sizes_of(patch: Patch, at: tuple[int, int], skin: Skin) -> Sizes | None:
    """Measure what lies around a cell of a patch; None if it has no outline.

    Parameters
    ----------
    patch : Patch
    at : (int, int)
        Row and column of the deepest cell.
    skin : Skin
    """
    measured = _measured(patch, at)
    if measured is None:
        return None
    values, outline = measured
    # The patch's own shape, by the depth that it has.
    high = float(values[0])
    radius, half = _radius(patch, outline, at, high), find_outline(patch, at, high, 0.5)
    # Of what the rim cuts, the skin is known on one side: as in a hole that is twice as wide.
    cut = is_cut(patch, outline)
    wide = (1 + cut) * outline.width
    unsure = skin.uncertainty(*outline.centre, wide)
    again = [_measured(each, at) for each in patch.varied(_FIELDS, unsure)]
    if not all(again):
        return None
    drawn = np.reshape([each[0] for each in again if each], (-1, 2, len(values)))
    off = drawn - values
    off[..., 3] = (off[..., 3] + math.pi / 2) % math.pi - math.pi / 2
    apart = np.square(off[:, 0] - off[:, 1])
    noise = _WIDER**2 * apart[:_FIELDS].mean(axis=0)
    # Noise makes a circle longer than wide. How much longer has an angle, as polarised light has:
    # noise adds the variance of both components to its square (Wardle and Kronberg, ApJ 194, 249,
    # 1974).
    longer = (drawn[..., 1] - drawn[..., 2]) * np.exp(2j * drawn[..., 3])
    added = np.square(np.abs(longer[:_FIELDS, 0] - longer[:_FIELDS, 1])).mean()
    values[1] = values[1:3].mean() + math.sqrt(max(np.ptp(values[1:3]) ** 2 - added, 0)) / 2
    # Outlines that are carried on or smoothed are unsure of lengths and widths, twice of areas.
    spread = np.sqrt(
        noise
        + apart[_FIELDS:].sum(axis=0)
        + np.square(outline.unsure * values * (0, 1, 1, 0, 2, 0))
    )
    depth, length, width, angle, area, volume = (
        Estimate(float(value), float(each)) for value, each in zip(values, spread, strict=True)
    )
    turned = math.hypot(angle.uncertainty, BETWEEN)
    return Sizes(
        outline,
        Estimate(angle.value, min(turned, math.pi / math.sqrt(12))),
        depth,
        length,
        width,
        area,
        volume,
        radius,
        math.inf if half is None else half.length[0] / max(half.width, 1e-12),
        cut,
        float(patch.over[outline.inside].mean()),
        float((patch.depth * (outline.inside & ~patch.over)).max()),
    )


def _measured(patch: Patch, at: tuple[int, int]) -> tuple[NDArray[np.float64], Outline] | None:
    """Depth, length, width, angle, area and volume; and the outline."""
    high = float(patch.depth[at])
    if not high > 0:
        return None
    # What noise may have made shallower than the deepest cell, down to half of its depth: their
    # difference has twice the variance.
    surely = max(high - math.sqrt(2) * SURE * float(patch.strays[at]), high / 2)
    depth = _bottom(patch, part_above(patch, at, surely))
    outline = find_outline(patch, at, depth, LEVEL)
    if outline is None or not outline.inside.any():
        return None
    mean = float(patch.depth[outline.inside].mean())
    length, angle = outline.length
    sizes = depth, length, outline.width, angle, outline.area, outline.area * mean
    return np.array(sizes), outline


def _bottom(patch: Patch, cap: Mask) -> float:
    """Depth of a paraboloid through the cap, at its middle cell: a maximum would pick noise.

    No bottom is a paraboloid: cells count less where the first one is off its middle.
    """
    x, y = ((each[cap] - each[cap].mean()).astype(float) for each in (patch.x, patch.y))
    # In metres bends are small: where the cells are too few, the least solution is flat.
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    middle, unsure = np.argmin(x * x + y * y), patch.unsure[cap]
    for _ in range(2):
        weighted = terms / np.square(unsure)
        found = np.linalg.lstsq(weighted @ terms.T, weighted @ patch.depth[cap], rcond=None)[0]
        depth = found @ terms
        unsure = np.hypot(unsure, depth - depth[middle])
    return float(depth[middle])


def _radius(patch: Patch, outline: Outline, at: tuple[int, int], depth: float) -> float:
    """Radius of curvature of the parabola as wide at the rim of the bottom; NaN in a gap."""
    distances = outline.width * _ACROSS
    angle = outline.length[1] + math.pi / 2
    found, measured = patch.along(patch.x[at], patch.y[at], angle, distances)
    if not measured[np.abs(distances) < outline.width / 2].all():
        return math.nan
    middle = len(distances) // 2
    low = found < CAP * depth
    sides = np.argmax(low[middle::-1]), np.argmax(low[middle:])
    reach = sum(int(each) or middle for each in sides) * (distances[1] - distances[0])
    return float(reach**2 / (8 * (1 - CAP) * depth))
