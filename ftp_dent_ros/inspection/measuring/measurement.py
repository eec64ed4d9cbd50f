"""A dent's sizes with their uncertainties, from the surface itself, on the full cloud."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent, orientation_of
from ftp_dent_ros.inspection.measuring.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.dent_model import DentModel, fit_dent
from ftp_dent_ros.inspection.measuring.detection import SIGNIFICANT, SUSPECT, Candidate
from ftp_dent_ros.inspection.measuring.division import LEVELS, divided, looks_compound
from ftp_dent_ros.inspection.measuring.kinds import Appearance, kind_of
from ftp_dent_ros.inspection.measuring.maxima import DROP, maxima_of
from ftp_dent_ros.inspection.measuring.noise import Noise
from ftp_dent_ros.inspection.measuring.outline import Outline, find_outline
from ftp_dent_ros.inspection.measuring.patch import Patch, sampled
from ftp_dent_ros.inspection.measuring.peak import bottom_of, extent, part_above, radius_across
from ftp_dent_ros.inspection.measuring.placement import axis_along, on_skin, profile_of
from ftp_dent_ros.inspection.measuring.restoration import Restored, restored
from ftp_dent_ros.inspection.measuring.surroundings import Surroundings
from ftp_dent_ros.inspection.settings import Settings

LEVEL = 0.1
# A candidate that is so many times longer than wide is a ridge, unless its saddles are so deep.
_RIDGE, _RIDGE_DROP = 3.5, 0.5
# Cells of the patch along a dent, and across one at least.
_CELLS = 64
_ACROSS = 14
# Standard uncertainties that a crease's or gouge's depth has at least, and all others' twice as
# many, for the kind to be told: fittings that are not resolved come out round.
_CERTAIN = 3.0
_MM = 1e3
# Of the smoothing: part of the dent's width at most, and of its depth that noise may be.
_WIDEST = 0.04
_SMALLEST = 0.02
_MODEL_CELLS = 22
# Maxima are looked for from this part of the smallest depth on.
_NEARLY = 0.8
# At half of its depth a Gaussian, the most pointed of dents, has 0.55 of its width at 10 %: what
# is shorter than that part of the smallest width is a rivet, however wide the ripples around it.
_SPIKE = 0.55
# Of the depth, and of the cells in which outlines are found: errors of the sampling.
_SAMPLING = 0.0015
_GRAIN = 0.06
# Part of the outline's errors that does not even out along it.
_EVENED = 0.6
# What the uncertainties of lengths and widths were short of, over shapes of nine families, each
# with the others, in photographs of their own: rims are smoothed more than the resolution tells.
# `benchmarks/dent_shapes.py --seed 77` judges them on others.
_OF_LENGTH, _OF_WIDTH = 1.4, 2.4
# Of what is as narrow as the resolution: uncertainty of the depth, as a part of it, and of the
# sizes, as a part of the resolution; it falls with the square of their ratio.
_UNRESOLVED_DEPTH, _UNRESOLVED_SIZE = 0.15, 0.4
# Points of a cloud that does not tell its resolution show waves of so many spacings by half.
_SUPPOSED = 4.0

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


def measure(
    candidate: Candidate,
    around: Surroundings,
    skin: BareSkin,
    settings: Settings,
) -> list[MeasuredDent]:
    """Measure every dent of a candidate that is not too small.

    Parameters
    ----------
    candidate : Candidate
    around : Surroundings
    skin : BareSkin
    settings : Settings
    """
    raw = _patch(candidate, around, skin.noise)
    seen = restored(raw, around.resolution, _SUPPOSED * around.spacing)
    local = float(skin.noise.after(raw.scale, around.extra))
    own = _own(seen.patch, around)
    # Along a ridge the depth varies as the fringes do.
    drop = _RIDGE_DROP if candidate.length > _RIDGE * candidate.width else DROP
    peaks = [
        peak
        for peak in maxima_of(seen.patch, local, _NEARLY * settings.smallest_depth, drop)
        if own[peak] and not _is_spike(seen.patch, peak, settings)
    ]
    dents = []
    for peak, region in zip(peaks, divided(seen.patch, peaks, LEVEL), strict=True):
        found = _one(candidate.sign, seen, peak, region, around, skin, settings)
        if found is not None:
            dents.append(found)
    return dents


def _own(patch: Patch, around: Surroundings) -> Mask:
    """Cells of the patch that are the candidate's, not another one's beside it."""
    column, row = (
        np.rint(each).astype(int) for each in patch.cells(around.cells[0], around.cells[1])
    )
    rows, columns = patch.depth.shape
    own = np.zeros((rows, columns), np.uint8)
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    own[row[inside], column[inside]] = 1
    size = 2 * math.ceil(0.75 * around.cell / patch.step) + 1
    return cv2.dilate(own, np.ones((size, size), np.uint8)) > 0


def _patch(candidate: Candidate, around: Surroundings, noise: Noise) -> Patch:
    """Depths around a candidate, smoothed as its noise demands and its size allows."""
    size = min(2 * math.sqrt(candidate.area / math.pi), candidate.width)
    spread = max(np.ptp(around.bounds[:2]), np.ptp(around.bounds[2:]))
    step = max(around.spacing, min(spread / (2 * _CELLS), size / _ACROSS))
    scale = max(_SMALLEST * size, 0.7 * step)
    while scale < _WIDEST * size and noise.after(scale, around.extra) > 0.01 * candidate.height:
        scale *= 1.3
    depth = candidate.sign * around.depth
    return Patch.of(around.x, around.y, depth, around.bounds, step, scale)


def _is_spike(patch: Patch, at: tuple[int, int], settings: Settings) -> bool:
    length, width, _ = extent(patch, at, 0.5)
    # The patch's own smoothing widens what is short.
    least = math.hypot(_SPIKE * settings.smallest_width, 2 * patch.scale)
    return math.sqrt(length * width) < least


def _one(
    sign: int,
    seen: Restored,
    at: tuple[int, int],
    region: Mask | None,
    around: Surroundings,
    skin: BareSkin,
    settings: Settings,
) -> MeasuredDent | None:
    patch, contour, noise = seen.patch, skin.contour, skin.noise
    correlated = noise.correlated_area / patch.step**2
    local = float(noise.after(patch.scale, around.extra))
    bottom = bottom_of(patch, at, local, correlated, region)
    deepest = bottom.depth
    outline = find_outline(patch, at, LEVEL * deepest, region)
    if outline is None or outline.area <= 0:
        return None
    x, y = outline.centre
    length, angle, length_flatness = outline.length()
    width, width_flatness = outline.width(angle)
    offset = skin.uncertainty(x, y, width)
    by_chance = float(noise.after(0.1 * width, around.extra))
    told = around.resolution if math.isfinite(around.resolution) else 0.0
    fine = min(told / width, 1.0) ** 2
    lost = math.hypot(float(seen.doubt[at]), _UNRESOLVED_DEPTH * fine * deepest)
    deep = math.sqrt(
        bottom.uncertainty**2
        + min(by_chance, local) ** 2
        + offset**2
        + lost**2
        + (_SAMPLING * deepest) ** 2
    )
    significance = deepest / max(by_chance, 1e-12)
    if significance < SUSPECT:
        return None
    radius = radius_across(patch, at, deepest, angle + math.pi / 2, width)
    kind, reason = kind_of(
        Appearance(
            sign * deepest,
            length,
            width,
            radius,
            around.resolution,
            _mark(around, patch, outline),
            outline.is_cut,
        ),
        settings,
    )
    if not kind:
        return None
    certain = _CERTAIN if kind in ('crease', 'gouge') else SIGNIFICANT
    if significance < SIGNIFICANT or deepest < certain * deep:
        if outline.is_cut:
            # At the rim the cloud is rarely sure.
            return None
        unsure = _MM * math.hypot(by_chance, deep)
        kind, reason = 'other', f'the cloud is not sure of the surface here ({unsure:.2f} mm)'
    if not reason and kind == 'dent':
        parts = [part_above(patch, at, level * deepest, region) for level in LEVELS]
        if region is not None:
            reason = 'overlaps another one: its outline ends where they part'
        elif looks_compound(parts, local / deepest):
            reason = 'may be several that overlap'
    # The contour and the level move all of the outline, the noise each end for itself.
    doubt = float(np.sqrt(np.square(_along(patch, seen.doubt, outline)).mean()))
    shift = math.hypot(offset, LEVEL * deep, doubt)
    ends = math.hypot(math.sqrt(2) * local, 2 * shift)
    cell, grain = patch.step**2, _GRAIN * patch.step
    perimeter = float(np.hypot(*np.diff([outline.x, outline.y], append=0)[:, :-1]).sum())
    flatness = float(np.mean(1 / outline.slope))
    independent = math.sqrt(max(perimeter / math.sqrt(noise.correlated_area), 1))
    area_error = perimeter * math.hypot(
        flatness * local / independent, _EVENED * math.hypot(flatness * shift, grain / 2)
    )
    model = _model(patch, region, outline, deepest, correlated)
    normal = contour.normal(np.array([x]), np.array([y]))[0]
    axis = axis_along(contour, normal, outline.axis())
    model_length, model_width = model.axes
    length_error, width_error = model.axes_uncertainty
    unresolved = _UNRESOLVED_SIZE * fine * told
    u_length = math.hypot(_OF_LENGTH * math.hypot(ends * length_flatness, grain), unresolved)
    u_width = math.hypot(_OF_WIDTH * math.hypot(ends * width_flatness, grain), unresolved)
    return MeasuredDent(
        kind=kind,
        reason=reason,
        position=contour.point(np.array([x]), np.array([y]))[0],
        normal=normal,
        axis=axis,
        depth=Estimate(sign * deepest, deep),
        length=Estimate(length, u_length),
        width=Estimate(width, u_width),
        model_length=Estimate(model_length, math.hypot(length_error, u_length)),
        model_width=Estimate(model_width, math.hypot(width_error, u_width)),
        orientation=Estimate(
            orientation_of(normal, axis), _turn(length, width, u_length, u_width)
        ),
        area=Estimate(outline.area, area_error),
        volume=Estimate(
            sign * float((patch.depth * outline.inside).sum()) * cell,
            math.hypot(
                outline.area * offset,
                noise.after(0, around.extra) * math.sqrt(noise.correlated_area * outline.area),
            ),
        ),
        bottom_radius=radius,
        significance=significance,
        is_cut=outline.is_cut,
        outline=on_skin(contour, outline, sign * LEVEL * deepest),
        length_profile=profile_of(patch, sign, x, y, angle, length),
        width_profile=profile_of(patch, sign, x, y, angle + math.pi / 2, width),
    )


def _model(
    patch: Patch, region: Mask | None, outline: Outline, deepest: float, correlated: float
) -> DentModel:
    """Dent function (eq. 18) that lies closest to the patch, but for its neighbours."""
    every = math.ceil(max(patch.depth.shape) / _MODEL_CELLS)
    thin = slice(None, None, every), slice(None, None, every)
    known = patch.known if region is None else patch.known & region
    x, y = np.meshgrid(patch.x[thin[1]], patch.y[thin[0]])
    length, angle, _ = outline.length()
    width, _ = outline.width(angle)
    # Eq. 18 has 0.835 of its axes at 10 % of its depth.
    half = math.log(length / 2 / 0.835), math.log(width / 2 / 0.835)
    start = np.array([*outline.centre, *half, angle, deepest])
    return fit_dent(x, y, patch.depth[thin], known[thin], start, correlated / every**2)


def _turn(length: float, width: float, u_length: float, u_width: float) -> float:
    """Standard uncertainty of the long axis' angle, radians: any, of what is round."""
    oval = max(length**2 - width**2, 1e-12)
    spread = math.hypot(length * u_length, width * u_width) / oval
    return min(spread, math.pi / math.sqrt(12))


def _mark(around: Surroundings, patch: Patch, outline: Outline) -> float:
    """How the light in an outline differs from that beside it, as a part of the latter."""
    column, row = (np.rint(each).astype(int) for each in patch.cells(around.x, around.y))
    rows, columns = patch.depth.shape
    held = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    at, light = (row[held], column[held]), around.light[held]
    inside = outline.inside > 0.5
    wide = cv2.dilate(inside.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    within, without = light[inside[at]], light[(wide & (outline.inside == 0))[at]]
    if len(within) < 5 or len(without) < 5:
        return 0.0
    usual = float(np.median(without))
    return (float(np.median(within)) - usual) / usual if usual > 0 else 0.0


def _along(patch: Patch, values, outline: Outline) -> Vector:
    """Values of the patch's cells along an outline."""
    return sampled(values, *patch.cells(outline.x, outline.y), cv2.INTER_LINEAR)
