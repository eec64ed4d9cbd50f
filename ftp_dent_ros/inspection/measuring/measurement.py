"""A place to the dents that it holds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ftp_dent_ros.dents.dent import (
    COVERAGE,
    Estimate,
    MeasuredDent,
    SmallestDent,
    orientation_of,
)
from ftp_dent_ros.inspection.measuring.contour import Contour
from ftp_dent_ros.inspection.measuring.dent_model import UNKNOWN, model_axes
from ftp_dent_ros.inspection.measuring.detection import TENTH, Place
from ftp_dent_ros.inspection.measuring.kinds import kind_of
from ftp_dent_ros.inspection.measuring.lattice import LEVEL, Lattice
from ftp_dent_ros.inspection.measuring.noise import SURE, Map, combined, smoother
from ftp_dent_ros.inspection.measuring.outline import CUT
from ftp_dent_ros.inspection.measuring.patch import Patch, patch_of
from ftp_dent_ros.inspection.measuring.sizes import Sizes, sizes_of
from ftp_dent_ros.inspection.measuring.skin import Skin

# Depths that maxima are looked at from, to find their saddles.
_LEVELS = 32
# Of a profile, in lengths of the dent.
_PROFILE = np.linspace(-0.83, 0.83, 81)
_OVERLAPS = 'overlaps another one: each is taken to be alike on both sides'
_SEVERAL = 'may be several: what would part them is hardly more than noise'
_NO_PROFILE = np.zeros((0, 2))

Vector = NDArray[np.float64]


def measure(
    place: Place, skin: Skin, lattice: Lattice, settings: SmallestDent
) -> list[MeasuredDent]:
    """Measure every dent of a place that is not too small.

    What cannot be measured is listed with what is known of it.

    Parameters
    ----------
    place : Place
    skin : Skin
    lattice : Lattice
    settings : SmallestDent
    """
    patch = patch_of(place, skin, lattice)
    # As wide as the smallest dent, a mean does not fill the saddle between two of them.
    scale = settings.smallest_width / TENTH
    cells = scale / patch.step[0], scale / patch.step[1]
    values = np.nan_to_num(smoother(patch.known, cells)(patch.depth))
    peaks, several = _peaks(patch, values, skin.noise.after(scale, patch.usual))
    sized = [(sizes_of(each, at, skin), each) for at, each in _alone(patch, values, peaks)]
    if not any(sizes for sizes, _ in sized):
        return _unmeasured(place, patch, skin.contour, settings)
    shared = _SEVERAL if several else _OVERLAPS if len(peaks) > 1 else ''
    return [
        _dent(place, sizes, kind, each, skin)
        for sizes, each in sized
        if sizes is not None
        and (kind := kind_of(sizes, place.sign, patch.resolution, settings, shared))[0]
    ]


def _peaks(patch: Patch, values: Map, noise: NDArray) -> tuple[list[tuple[int, int]], bool]:
    """Rows and columns of the maxima that stand out from their saddles, the deepest first.

    And whether one more may do so.

    Parameters
    ----------
    patch : Patch
    values : ndarray, shape (rows, columns), float32
        Its depths after a mean, metres.
    noise : ndarray, shape ()
        Of these, metres.
    """
    # Noise has many places to make a saddle; what was put back is too much, or lies elsewhere.
    doubt = np.abs(patch.doubts).max(axis=0)
    sure, likely = np.hypot(SURE * noise, COVERAGE * doubt), COVERAGE * np.hypot(noise, doubt)
    top = cv2.dilate(values, np.ones((5, 5), np.uint8))
    at = np.argwhere((values == top) & patch.own & (values > 0))
    order = np.argsort(-values[tuple(at.T)], kind='stable')
    at, heights = at[order], values[tuple(at[order].T)]
    if len(at) < 2:
        return [(int(row), int(column)) for row, column in at], False
    saddles = np.zeros((len(at), len(at)))
    step = float(heights[0]) / _LEVELS
    for level in step * np.arange(_LEVELS):
        _, labels = cv2.connectedComponents((values > level).view(np.uint8))
        place = labels[tuple(at.T)]
        saddles[(place[:, None] == place) & (place > 0)] = level
    kept, several = [0], False
    for index in range(1, len(at)):
        fall = heights[index] - saddles[index, kept].max() - step
        if fall > LEVEL * heights[index]:
            if fall > sure[tuple(at[index])]:
                kept.append(index)
            several |= bool(sure[tuple(at[index])] >= fall > likely[tuple(at[index])])
    return [(int(row), int(column)) for row, column in at[kept]], several


def _alone(
    patch: Patch, values: Map, peaks: list[tuple[int, int]]
) -> Iterator[tuple[tuple[int, int], Patch]]:
    """Each peak, and the patch as it would be without the others.

    A dent is as deep on one side of its peak as on the other: in this ratio they share what is
    there (Lupton, The SDSS image deblender, 2005). Where that side is not known, or none claims
    anything, water divides the place. How far the two divisions differ is in doubt.
    """
    found = np.ones(values.shape, np.int32)
    if peaks[1:]:
        marks = np.zeros_like(found)
        marks[tuple(np.transpose(peaks))] = 1 + np.arange(len(peaks))
        # Of 16 bits SciPy 1.11 floods 15.
        below = np.iinfo(np.int16).max * (1 - np.maximum(values, 0) / values.max())
        found = ndimage.watershed_ift(np.uint16(below), marks, np.ones((3, 3)))
    rows, columns = np.indices(found.shape)
    claims = []
    for index, (row, column) in enumerate(peaks, 1):
        opposite, known = (
            patch.at(each, 2 * column - columns, 2 * row - rows, cv2.INTER_NEAREST)
            for each in (values, np.uint8(patch.known))
        )
        # Less than any depth that is measured.
        least = np.where(known, 1e-6, values) * (found == index)
        claims.append(np.maximum(opposite * known, least))
    total = np.maximum(sum(claims), 1e-12)
    for index, (at, claim) in enumerate(zip(peaks, claims, strict=True), 1):
        share, doubts, all_unsure = np.float32(claim / total), patch.doubts, patch.unsure
        if peaks[1:]:
            # A range is its half over the root of three uncertain.
            unsure = patch.depth * ((found == index) - share) / np.float32(math.sqrt(12))
            doubts = np.concatenate([unsure[None], doubts])
            all_unsure = combined(all_unsure, unsure)
        yield at, replace(patch, depth=patch.depth * share, doubts=doubts, unsure=all_unsure)


def axis_along(contour: Contour, normal: Vector, angle: float) -> Vector:
    """Unit vector along the skin at an angle from the contour's x axis."""
    along = contour.axes[0] * math.cos(angle) + contour.axes[1] * math.sin(angle)
    along = along - normal * (along @ normal)
    return along / np.linalg.norm(along)


def _dent(
    place: Place,
    sizes: Sizes,
    kind: tuple[str, str],
    patch: Patch,
    skin: Skin,
) -> MeasuredDent:
    """What is listed of a dent."""
    outline, contour, sign = sizes.outline, skin.contour, place.sign
    feet, outward = contour.foot(*(np.append(each, each[0]) for each in (outline.x, outline.y)))
    (position,), (normal,) = contour.foot(*(np.array([each]) for each in outline.centre))
    axis = axis_along(contour, normal, outline.axis)
    model_length, model_width = model_axes(patch, sizes)
    turns = sizes.angle.value, sizes.angle.value + math.pi / 2
    lengthwise, crosswise = (
        _profile(patch, outline.centre, turn, sign, each.value)
        for turn, each in zip(turns, (sizes.length, sizes.width), strict=True)
    )
    return MeasuredDent(
        kind=kind[0],
        reason=kind[1],
        position=position,
        normal=normal,
        axis=axis,
        depth=Estimate(sign * sizes.depth.value, sizes.depth.uncertainty),
        length=sizes.length,
        width=sizes.width,
        model_length=model_length,
        model_width=model_width,
        orientation=Estimate(orientation_of(normal, axis), sizes.angle.uncertainty),
        area=sizes.area,
        volume=Estimate(sign * sizes.volume.value, sizes.volume.uncertainty),
        bottom_radius=sizes.radius,
        significance=place.significance,
        is_cut=sizes.is_cut or sizes.hidden > CUT,
        outline=feet - sign * LEVEL * sizes.depth.value * outward,
        length_profile=lengthwise,
        width_profile=crosswise,
    )


def _profile(
    patch: Patch, centre: tuple[float, float], angle: float, sign: int, size: float
) -> Vector:
    """Depths along a line, shape (n, 2), a third of the size beyond both ends."""
    along = size * _PROFILE
    depth, measured = patch.along(*centre, angle, along)
    return np.stack([along, np.where(measured, sign * depth, np.nan)], axis=-1)


def _unmeasured(
    place: Place, patch: Patch, contour: Contour, settings: SmallestDent
) -> list[MeasuredDent]:
    """What is known of a place that has no outline: a bound of its depth, and its cells' sizes."""
    own = patch.own & patch.known
    shown = own & ~patch.over
    depth = float(patch.depth[shown].max(initial=0.0))
    if depth < settings.smallest_depth:
        return []
    cell = max(patch.step)
    across = np.stack([patch.x[own], patch.y[own]], axis=1).astype(np.float32)
    _, sides, degrees = cv2.minAreaRect(across)
    length, width = max(sides) + cell, min(sides) + cell
    if length < settings.smallest_width:
        return []
    angle = math.radians(degrees) + (math.pi / 2 if sides[0] < sides[1] else 0.0)
    corners = cv2.convexHull(across)[:, 0].astype(float)
    feet, _ = contour.foot(*np.append(corners, corners[:1], axis=0).T)
    (position,), (normal,) = contour.foot(*across.mean(axis=0, dtype=float)[:, None])
    axis = axis_along(contour, normal, angle)
    return [
        MeasuredDent(
            kind='other',
            reason=f'not measured at its bottom: at least {1e3 * depth:.2f} mm deep',
            position=position,
            normal=normal,
            axis=axis,
            # A bound, and nothing is known of how far the depth exceeds it.
            depth=Estimate(place.sign * depth, depth),
            length=Estimate(length, cell),
            width=Estimate(width, cell),
            model_length=UNKNOWN,
            model_width=UNKNOWN,
            orientation=Estimate(orientation_of(normal, axis), math.pi / math.sqrt(12)),
            area=Estimate(np.count_nonzero(own) * math.prod(patch.step), length * cell),
            volume=UNKNOWN,
            bottom_radius=math.nan,
            significance=place.significance,
            is_cut=True,
            outline=feet,
            length_profile=_NO_PROFILE,
            width_profile=_NO_PROFILE,
        )
    ]
