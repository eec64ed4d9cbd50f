"""Sizes of one dent and their uncertainties, from its patch and outline."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.inspection.measuring.outlines.bridging import Bridged
from ftp_dent_ros.inspection.measuring.outlines.clear_level import clear_outline
from ftp_dent_ros.inspection.measuring.outlines.outline import Outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch, sampled
from ftp_dent_ros.inspection.measuring.outlines.peak import bottom_of
from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.evidence import TENTH, chance, fitted_depth
from ftp_dent_ros.inspection.measuring.places.kinds import LONG
from ftp_dent_ros.inspection.measuring.places.surroundings import Surroundings
from ftp_dent_ros.robust import median

#: Of the depth, where length, width and area are measured.
LEVEL = 0.1
# Of the depth, and of the cells in which outlines are found: errors of the sampling.
_SAMPLING = 0.0015
_GRAIN = 0.06
# Part of the outline's errors that does not even out along it.
_EVENED = 0.6
#: What the uncertainties of depths, and of lengths and widths, are short of over nine families of
# shapes, each left out in turn. Depths: 1.1, on 57 dents. Sizes: 1.1, on 42, and a sixth wider,
# for so few dents know it no better.
OF_DEPTH, _OF_SIZES = 1.1, 1.3
#: Of what is as narrow as the resolution: uncertainty of the depth, as a part of it, and of the
# sizes, as a part of the resolution; it falls with the square of their ratio.
UNRESOLVED_DEPTH, _UNRESOLVED_SIZE = 0.15, 0.4
# The same of the depth of what is long: a valley may be sharp.
_VALLEY = 0.25
# An outline that is so many times deeper than its level is drawn where a dent parts from another;
# how far the sizes may be off for such a part of it, as parts of them.
_DEEPER, _PARTED = 1.5, 0.6
# Where flanks meet at the bottom of a valley, a surface restored to second order still lacks this
# part of the depth, times resolution over width, from widths of 0.9 resolutions on: calculated of
# flanks that are straight (0.13) and that die out with their square (0.20); and, if it cannot be
# seen whether they meet, of anything from a round bottom (0) on. Middle and half of the range.
_KINK, _ANY = (0.18, 0.04), (0.11, 0.11)
_LEAST = 1e-12  # metres: no division by zero

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Sizes:
    """What is measured of one dent.

    Attributes
    ----------
    outline : Outline
        At `LEVEL`.
    angle : float
        Of the length, from the patch's x axis, radians.
    depth, length, width, turn, area, volume : Estimate
        Metres, square and cubic metres, inward positive; `turn` is the angle, radians.
    unresolved : float
        Standard uncertainty of the depth by what the reconstruction smoothed, metres.
    significance : float
        Depth of the Gaussian that fits best, over that of one fitted to the noise.
    chance : float
        The latter, metres.
    hidden : float
        Part of the area that was not measured.
    """

    outline: Outline
    angle: float
    depth: Estimate
    length: Estimate
    width: Estimate
    turn: Estimate
    area: Estimate
    volume: Estimate
    unresolved: float
    significance: float
    chance: float
    hidden: float


def sizes_of(
    seen: Bridged,
    plain: Patch,
    at: tuple[int, int],
    region: Mask | None,
    around: Surroundings,
    skin: BareSkin,
) -> Sizes | None:
    """Measure what lies around the deepest cell of a patch; None if it has no outline.

    Parameters
    ----------
    seen : Bridged
    plain : Patch
        The same before it was restored, whose noise that raised as well.
    at : (int, int)
        Row and column of the deepest cell.
    region : ndarray, shape (rows, columns), bool, optional
        Cells that are this dent's.
    around : Surroundings
    skin : BareSkin
    """
    patch, noise = seen.patch, skin.noise
    local = noise.where(around.extra, patch.scale)
    strays = noise.over(patch.stated, patch.scale)
    bottom = bottom_of(patch, at, strays, noise.correlated_area / patch.step**2, region)
    drawn = clear_outline(patch, at, bottom.depth, LEVEL, region, local)
    if drawn is None:
        return None
    outline, level, carried = drawn
    length, angle, tips = outline.length()
    width, sides = outline.width(angle)
    # Of what the rim cuts, the skin is known on one side: as in a hole that is twice as wide.
    offset = skin.uncertainty(*outline.centre, (2 if outline.is_cut else 1) * width)
    by_chance = chance(noise, width, around.extra)
    overall = chance(noise, math.sqrt(length * width), around.extra)
    resolution = around.resolution if math.isfinite(around.resolution) else 0.0
    fine = min(resolution / width, 1.0) ** 2
    # Of a Gaussian, the patch's own smoothing leaves this out (a mean, and that of the rest).
    apart = (TENTH * patch.scale / width) ** 2
    smeared = (apart / (1 + apart)) ** 2 * bottom.depth
    part = _VALLEY if length > LONG * width else UNRESOLVED_DEPTH
    # What is carried on over a gap errs with the square of its width, and may be the deepest.
    hidden = float((outline.inside * seen.bridged).sum() / outline.inside.sum())
    guessed = hidden**2 * bottom.depth
    lost = math.hypot(float(seen.doubt[at]), part * fine * bottom.depth, smeared, guessed)
    deep = OF_DEPTH * math.hypot(
        bottom.uncertainty, min(by_chance, local), offset, lost, _SAMPLING * bottom.depth
    )
    # Noise as it is beside the dent moves each end for itself. The contour and the level move all
    # of the outline, and so does what the cloud doubts of it beyond that noise: what smoothing
    # takes (as the restoration's doubt says, too) and what the light on its slopes feigns.
    usual = _beside(patch, outline, around.extra)
    alone = noise.where(usual, patch.scale)
    beyond = np.square(_along(patch, patch.stated, outline)) - usual**2
    doubt = np.square(_along(patch, seen.doubt, outline)).mean()
    together = np.sqrt(offset**2 + (level * deep) ** 2 + np.maximum(beyond, doubt))
    grain, unresolved = _GRAIN * patch.step, _UNRESOLVED_SIZE * fine * resolution
    u_length, u_width = (
        math.hypot(
            _OF_SIZES * _apart(outline, alone, together, ends), _OF_SIZES * grain, unresolved
        )
        for ends in (tips, sides)
    )
    parted = _PARTED * _parted(patch, region, outline, bottom.depth)
    # Where noise passes the level beside the dent, the outline runs on into it, the longer way.
    passes = math.erfc(level * bottom.depth / max(math.sqrt(2) * local, _LEAST))
    astray = passes * math.sqrt(noise.correlated_area)
    u_length = math.hypot(u_length, parted * length, astray, carried * length)
    u_width = math.hypot(u_width, parted * width, carried * width)
    flatness = float((1 / outline.slope).mean())
    independent = math.sqrt(max(outline.perimeter / math.sqrt(noise.correlated_area), 1))
    shift = math.sqrt(float(together @ together) / len(together))
    u_area = outline.perimeter * math.hypot(
        flatness * local / independent, _EVENED * math.hypot(flatness * shift, grain / 2)
    )
    u_area = math.hypot(u_area, 2 * carried * outline.area)
    volume = float((patch.depth * outline.inside).sum()) * patch.step**2
    u_volume = math.hypot(
        outline.area * offset,
        noise.where(around.extra, 0) * math.sqrt(noise.correlated_area * outline.area),
        hidden**2 * volume,
    )
    return Sizes(
        outline,
        angle,
        Estimate(bottom.depth, deep),
        Estimate(length, u_length),
        Estimate(width, u_width),
        Estimate(angle, _turn(length, width, u_length, u_width)),
        Estimate(outline.area, u_area),
        Estimate(volume, u_volume),
        lost,
        fitted_depth(plain, outline, length, width, angle) / max(overall, 1e-12),
        overall,
        hidden,
    )


def of_sharp_bottom(sizes: Sizes, resolution: float, is_resolved: bool) -> Sizes:
    """The sizes of what is sharp at its bottom, which smoothing has made rounder and shallower."""
    if not math.isfinite(resolution):
        return sizes
    part = min(resolution / sizes.width.value, 1.0)
    lack, within = _KINK if is_resolved else _ANY
    value = sizes.depth.value / (1 - lack * part)
    # A range is its half over the root of three uncertain.
    unsure = math.hypot(sizes.depth.uncertainty, within / math.sqrt(3) * part * value)
    return replace(sizes, depth=Estimate(value, unsure))


def _turn(length: float, width: float, u_length: float, u_width: float) -> float:
    """Standard uncertainty of the long axis' angle, radians: any, of what is round."""
    oval = max(length**2 - width**2, 1e-12)
    spread = math.hypot(length * u_length, width * u_width) / oval
    return min(spread, math.pi / math.sqrt(12))


def _parted(patch: Patch, region: Mask | None, outline: Outline, depth: float) -> float:
    """Part of an outline that is drawn where a dent parts from another one: deeper than its."""
    if region is None:
        return 0.0
    return float((patch.at(outline.x, outline.y) > _DEEPER * LEVEL * depth).mean())


def _apart(outline: Outline, alone: float, together: Vector, ends: list[int]) -> float:
    """Standard uncertainty of the distance of two ends of an outline, metres.

    By depths that stray at each for itself, and by what strays at both alike, metres.
    """
    flatness = 1 / outline.slope[ends]
    return float(np.hypot(alone * np.linalg.norm(flatness), together[ends] @ flatness))


def _beside(patch: Patch, outline: Outline, otherwise: float) -> float:
    """What the cloud states of the points around an outline, the median, metres."""
    beside = patch.stated[patch.known & (outline.inside == 0)]
    return median(beside) if len(beside) else otherwise


def _along(patch: Patch, values: Vector, outline: Outline) -> Vector:
    """Values of the patch's cells along an outline."""
    return sampled(values, *patch.cells(outline.x, outline.y), cv2.INTER_LINEAR)
