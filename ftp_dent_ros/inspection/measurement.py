"""A dent's sizes with their uncertainties, on the full cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.blurring import Grid
from ftp_dent_ros.inspection.contour import Contour
from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent
from ftp_dent_ros.inspection.detection import Candidate
from ftp_dent_ros.inspection.model import FittedDents, fit_dents
from ftp_dent_ros.inspection.noise import Noise
from ftp_dent_ros.inspection.outline import Outline, find_outline
from ftp_dent_ros.inspection.patch import Patch, sampled
from ftp_dent_ros.inspection.peak import deepest_of, extent, highest
from ftp_dent_ros.inspection.placing import axis_along, on_skin, orientation_of, profile_of
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.inspection.sharpening import Sharpened, sharpened

LEVEL = 0.1
# Cells of the patch along a dent, and of the points that are resampled to it.
_CELLS = 64
# Of the smoothing: part of the dent's width at most, and of its depth that noise may be.
_WIDEST = 0.04
_SMALLEST = 0.02
_MODEL_CELLS = 30
# A first look has to find this part of the smallest dent.
_NEARLY = 0.8
# At half of its depth the smallest dent is 0.77 of its width at 10 %: a rivet in its ripples is
# narrower than this part of it.
_SPIKE = 0.65
# What the rim cuts must be so many times as deep, for the contour is known on one side of it only;
# what lies along it, longer than so many widths, even more.
_CUT = 4.0
_STRIP, _STRIP_CUT = 2.8, 8.0
# Of the depth, and of the cells in which outlines are found: errors of the sampling.
_SAMPLING = 0.0015
_GRAIN = 0.06
# How far off the reconstruction's smoothing leaves a dent's foot, as a part of the depth.
_FORM = 0.006
# Of lengths and widths, metres: what the reconstruction's windows widen beyond the fitted blur.
_BLURRED = 1.5e-4
# Part of them that does not even out along an outline.
_EVENED = 0.6

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Points of the cloud around one candidate, on their panel.

    Attributes
    ----------
    x, y, depth : ndarray, shape (n,)
        Feet on the contour and depths below it, metres.
    peaks : ndarray, shape (dents, 2)
        x, y of the candidate's maxima.
    spacing : float
        Between points, metres.
    bounds : tuple of 4 floats
        x_min, x_max, y_min, y_max.
    extra : float
        Noise beyond the common one here, metres.
    """

    x: Vector
    y: Vector
    depth: Vector
    peaks: Vector
    spacing: float
    bounds: tuple[float, float, float, float]
    extra: float


def least_depth(is_cut: bool, length: float, width: float, settings: Settings) -> float:
    """Depth from which on a dent is reported, metres."""
    times = 1.0
    if is_cut:
        times = _STRIP_CUT if length > _STRIP * width else _CUT
    return times * settings.smallest_depth


def measure(
    candidate: Candidate,
    around: Surroundings,
    contour: Contour,
    noise: Noise,
    area: float,
    settings: Settings,
) -> list[MeasuredDent]:
    """Measure every dent of a candidate that is not too small, nor an artefact of the rim.

    Parameters
    ----------
    candidate : Candidate
    around : Surroundings
    contour : Contour
        In the frame of the cloud.
    noise : Noise
    area : float
        Of the candidate, square metres.
    settings : Settings
    """
    depth = candidate.sign * around.depth
    size = 2 * math.sqrt(area / len(around.peaks) / math.pi)
    spread = max(np.ptp(around.bounds[:2]), np.ptp(around.bounds[2:]))
    step = max(around.spacing, spread / (2 * _CELLS))
    scale = max(_SMALLEST * size, 0.7 * step)
    while (
        scale < _WIDEST * size and noise.after(scale, around.extra) > 0.01 * candidate.heights[-1]
    ):
        scale *= 1.3
    raw = Patch.of(around.x, around.y, depth, around.bounds, step, scale)
    if len(around.peaks) == 1 and not _is_worth(raw, around.peaks[0], settings):
        return []
    fitted = _fitted(raw, candidate, around.peaks, noise, size)
    spread = float(noise.after(scale, around.extra))
    dents = []
    for index, each in enumerate(sharpened(raw, fitted, spread)):
        found = _one(candidate.sign, each, around, index, fitted, contour, noise, settings)
        if found is not None:
            dents.append(found)
    return dents


def _is_worth(patch: Patch, peak: Vector, settings: Settings) -> bool:
    """Whether a closer look may find a dent large enough, and not a strip along the rim."""
    at = highest(patch, peak)
    if at is None or _is_spike(patch, at, settings):
        return False
    length, width, is_cut = extent(patch, at, LEVEL)
    deep = patch.depth[at] > _NEARLY * least_depth(is_cut, length, width, settings)
    return bool(deep and width > _NEARLY * settings.smallest_width)


def _is_spike(patch: Patch, at: tuple[int, int], settings: Settings) -> bool:
    """Whether it is narrower than a dent: a rivet, however wide the ripples around it."""
    _, width, _ = extent(patch, at, 0.5)
    return width < _SPIKE * settings.smallest_width


def _fitted(
    patch: Patch, candidate: Candidate, peaks: Vector, noise: Noise, size: float
) -> FittedDents:
    """Dent functions of all the candidate's dents, fitted together."""
    every = math.ceil(max(patch.depth.shape) / _MODEL_CELLS)
    coarse = Grid(patch.x[::every], patch.y[::every])
    starts = np.zeros((len(peaks), 6))
    starts[:, :2] = peaks
    starts[:, 2:4] = math.log(0.65 * size)
    starts[:, 5] = candidate.heights
    if len(peaks) == 1:
        x, y = np.meshgrid(patch.x, patch.y)
        inside = patch.known & (patch.depth > LEVEL * candidate.heights[0])
        if inside.sum() > 8:
            spread = np.cov(np.stack([x[inside], y[inside]])) + patch.step**2 * np.eye(2) / 12
            values, vectors = np.linalg.eigh(spread)
            starts[0, 2:4] = np.log(2.3 * np.sqrt(values[::-1]))
            starts[0, 4] = math.atan2(vectors[1, 1], vectors[0, 1])
    correlated = noise.correlated_area / (every * patch.step) ** 2
    known = patch.known[::every, ::every]
    return fit_dents(coarse, patch.depth[::every, ::every], known, starts, correlated)


def _one(
    sign: int,
    seen: Sharpened,
    around: Surroundings,
    index: int,
    fitted: FittedDents,
    contour: Contour,
    noise: Noise,
    settings: Settings,
) -> MeasuredDent | None:
    patch, model = seen.patch, fitted.dents[index]
    at = highest(patch, around.peaks[index])
    if at is None or _is_spike(patch, at, settings):
        return None
    deepest = deepest_of(patch, at, seen.model) - float(seen.unsure[at])
    outline = find_outline(patch, at, LEVEL * deepest)
    if outline is None or outline.area <= 0:
        return None
    centre_x, centre_y = outline.centre
    length, angle, length_flatness = outline.length()
    width, width_flatness = outline.width(angle)
    local = noise.after(patch.scale, around.extra)
    offset = float(contour.uncertainty(np.array([centre_x]), np.array([centre_y]))[0])
    chance = noise.after(0.1 * width, around.extra)
    deep = math.hypot(chance, offset, seen.doubted[at], _SAMPLING * deepest)
    # The contour and the level move all of the outline, the noise each end for itself.
    doubt = float(np.sqrt(np.square(_along(patch, seen.doubted, outline)).mean()))
    shift = math.hypot(offset, LEVEL * deep, doubt, _FORM * deepest)
    ends = math.hypot(math.sqrt(2) * local, 2 * shift)
    cell, grain = patch.step**2, math.hypot(_GRAIN * patch.step, _BLURRED)
    volume = float((patch.depth * outline.inside).sum()) * cell
    perimeter = float(np.hypot(*np.diff([outline.x, outline.y], append=0)[:, :-1]).sum())
    flatness = float(np.mean(1 / outline.slope))
    independent = math.sqrt(max(perimeter / math.sqrt(fitted.alike), 1))
    area_error = perimeter * math.hypot(
        flatness * local / independent, _EVENED * math.hypot(flatness * shift, grain / 2)
    )
    normal = contour.normal(np.array([centre_x]), np.array([centre_y]))[0]
    longer = model.parameters[4] + math.pi / 2 * (model.parameters[3] > model.parameters[2])
    axis = axis_along(contour, normal, longer if seen.explained else outline.axis())
    model_length, model_width = model.axes
    length_error, width_error = model.axes_uncertainty
    return MeasuredDent(
        kind='dent' if sign > 0 else 'bump',
        position=contour.point(np.array([centre_x]), np.array([centre_y]))[0],
        normal=normal,
        axis=axis,
        depth=Estimate(sign * deepest, deep),
        length=Estimate(length, math.hypot(ends * length_flatness, grain)),
        width=Estimate(width, math.hypot(ends * width_flatness, grain)),
        model_length=Estimate(model_length, length_error),
        model_width=Estimate(model_width, width_error),
        orientation=Estimate(orientation_of(normal, axis), model.angle_uncertainty),
        area=Estimate(outline.area, area_error),
        volume=Estimate(
            sign * volume,
            math.hypot(
                outline.area * offset,
                noise.after(0, around.extra) * math.sqrt(fitted.alike * outline.area),
            ),
        ),
        significance=float(deepest / chance),
        is_cut=outline.is_cut,
        outline=on_skin(contour, outline, sign * LEVEL * deepest),
        length_profile=profile_of(patch, sign, centre_x, centre_y, angle, length),
        width_profile=profile_of(patch, sign, centre_x, centre_y, angle + math.pi / 2, width),
    )


def _along(patch: Patch, values, outline: Outline) -> Vector:
    """Values of the patch's cells along an outline."""
    return sampled(values, *patch.cells(outline.x, outline.y), cv2.INTER_LINEAR)
