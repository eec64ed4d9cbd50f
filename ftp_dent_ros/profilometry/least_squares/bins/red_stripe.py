"""The fringe that has no green and no blue: filled by its red, and the blur that it shows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import NO_AVERAGE, blurred
from ftp_dent_ros.robust import median

# Phase up to which green and blue are missing, a usual lens's blur with it, and up to which no
# lens blurs them, radians.
_STRIPE, _CLEAR = math.pi + 0.9, math.pi + 3.0
# Of what is missing in the middle: less is none.
_FAINT = 0.03
# Variance of a fringe 1 + cos from trough to trough, radians^2.
_SHARP = math.pi**2 / 3 - 2
_LEAST = 1e-3
# Standard deviation over rows of bins of the ratio of the colours.
_ROWS = 2.5
# Rows of bins that the blur is measured in, and steps of the phase, radians.
_EVERY, _STEP = 4, 0.4
# Grey levels that must be missing in the middle for a blur to be told, and phases that are seen.
_SEEN, _LEAST_PHASES = 5.0, 8


@dataclass(frozen=True, eq=False)
class WithoutStripe:
    """Light in which the stripe is a fringe like the others.

    Attributes
    ----------
    levels : ndarray, shape (rows, bins), float32
        Grey levels.
    blur : float
        Variance of all that blurs the stripe's edges, bins^2; zero where no stripe is seen.
    """

    levels: NDArray[np.float32]
    blur: float


def without_stripe(
    light: IntensityBins, phase: NDArray[np.float32], inside: NDArray[np.bool_], period: float
) -> WithoutStripe:
    """Take the red level in a red stripe to the grey that goes with it around.

    Parameters
    ----------
    light : IntensityBins
    phase : ndarray, shape (rows, bins), float32
        Absolute phase of the bins, radians.
    inside : ndarray, shape (rows, bins), bool
        Bins with fringes.
    period : float
        Of the fringes, bins.
    """
    if light.red is light.grey:
        return WithoutStripe(light.grey, 0.0)
    reach, blur = _reach_and_blur(light, phase, inside, period)
    band = _band(phase, inside, reach, period)
    if band is None:
        return WithoutStripe(light.grey, 0.0)
    grey, stripe = light.grey[band], np.abs(phase[band]) < reach
    filled = light.grey.copy()
    expected = _expected(light.red[band], grey, inside[band] & ~stripe, (period, _ROWS))
    filled[band] = np.where(stripe, expected, grey)
    return WithoutStripe(filled, blur)


def _reach_and_blur(light, phase, inside, period) -> tuple[float, float]:
    """Phase up to which green and blue are missing, and the variance of their edges' blur.

    Red, as the fringes around have it in grey, is what is missing; where its place scatters by
    more than that of a sharp fringe does, it is blurred.
    """
    rows = slice(None, None, _EVERY)
    red, grey, phase, inside = (each[rows] for each in (light.red, light.grey, phase, inside))
    band = _band(phase, inside, _CLEAR, period)
    if band is None:
        return _STRIPE, 0.0
    red, grey, phase, inside = (each[band] for each in (red, grey, phase, inside))
    stripe = np.abs(phase) < _CLEAR
    missing = _expected(red, grey, inside & ~stripe, (2 * period, NO_AVERAGE)) - grey
    seen = stripe & inside
    seen_phase, most = phase[seen], int(_CLEAR / _STEP)
    place = np.clip(np.rint(seen_phase / _STEP).astype(int), -most, most) + most
    count = np.bincount(place)
    # Where fringes are upright, bins have few phases.
    held = count > 0
    if np.count_nonzero(held) < _LEAST_PHASES:
        return _STRIPE, 0.0
    away, profile = (
        np.bincount(place, values)[held] / count[held] for values in (seen_phase, missing[seen])
    )
    middle = np.interp(0.0, away, profile)
    if middle < _SEEN:
        return _STRIPE, 0.0
    faint = np.abs(away[profile < _FAINT * middle])
    reach = min(max(float(faint.min(initial=_CLEAR)), _STRIPE), _CLEAR)
    weight = np.gradient(away) * np.where(np.abs(away) < reach, at_least(profile, 0.0), 0.0)
    weight /= weight.sum()
    spread = np.square(away) @ weight - np.square(away @ weight)
    slope = median(np.abs(np.diff(phase, axis=1))[(seen & (np.abs(phase) < math.pi))[:, 1:]])
    return reach, max(float(spread) - _SHARP, 0.0) / slope**2


def _band(phase, inside, reach, period) -> tuple[slice, slice] | None:
    """Columns of the stripe, and beside it; None if there is none."""
    columns = np.flatnonzero(((np.abs(phase) < reach) & inside).any(axis=0))
    if not len(columns):
        return None
    beside = 3 * math.ceil(period)
    return slice(None), slice(max(columns[0] - beside, 0), columns[-1] + beside + 1)


def _expected(red, grey, around, sigmas) -> NDArray[np.float32]:
    """Grey levels that go with red ones, by the regression of one on the other around."""
    weight = around.astype(np.float32)

    def mean(values):
        return blurred(weight * values, sigmas, cv2.BORDER_CONSTANT)

    total = at_least(mean(np.float32(1)), _LEAST)
    mean_red, mean_grey = mean(red) / total, mean(grey) / total
    variance = mean(red * red) / total - mean_red * mean_red
    covariance = mean(red * grey) / total - mean_red * mean_grey
    slope = covariance / at_least(variance, _LEAST)
    return mean_grey + slope * (red - mean_red)
