"""Where the skin departs from its contour beyond the noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.noise import Noise, median_of
from ftp_dent_ros.inspection.settings import Settings

# Standard deviations: with 1e4 independent places a frame, far below one false alarm in 100.
SIGNIFICANT = 6.0
_EDGE = 3.0
# A second maximum counts when the saddle lies so far below it, as a part of its height.
_SADDLE = 0.2
_LEVELS = 16

Mask = NDArray[np.bool_]
Map = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A connected place that departs from the contour.

    Attributes
    ----------
    sign : int
        1 inward, -1 outward.
    mask : ndarray, shape (rows, columns), bool
        Cells of the lattice.
    peaks : ndarray, shape (n, 2), int
        Row and column of each maximum, the highest first: touching dents have several.
    heights : ndarray, shape (n,)
        Of the smoothed deviation there, metres.
    """

    sign: int
    mask: Mask
    peaks: NDArray[np.intp]
    heights: NDArray[np.float64]


def find_candidates(
    maps: list[Map], noise: Noise, panel: Mask, settings: Settings
) -> list[Candidate]:
    """Places of one panel where a smoothed deviation exceeds its noise.

    Parameters
    ----------
    maps : list of ndarray, shape (rows, columns), float32
        Deviation smoothed at the noise's scales (without the first, 0), metres.
    noise : Noise
    panel : ndarray, shape (rows, columns), bool
        Cells to look at.
    settings : Settings
    """
    found = []
    floor = 0.25 * settings.smallest_depth
    spreads = [noise.after(scale) for scale in noise.scales[1:]]
    typical = [median_of(spread[panel]) if panel.any() else 0.0 for spread in spreads]
    sure = [np.maximum(SIGNIFICANT * usual, 2 * floor) for usual in spreads]
    quiet = [k for k, usual in enumerate(typical) if SIGNIFICANT * usual < 4 * floor]
    base = quiet[0] if quiet else len(maps) - 1
    spread = spreads[base]
    for sign in (1, -1):
        values = np.where(panel & np.isfinite(maps[base]), sign * maps[base], 0)
        above = values > np.maximum(_EDGE * spread, floor)
        seeds = np.zeros_like(panel)
        for smooth, least in zip(maps, sure, strict=True):
            with np.errstate(invalid='ignore'):
                seeds |= sign * smooth > least
        _, labels, stats, _ = cv2.connectedComponentsWithStats(above.astype(np.uint8))
        seeded = np.unique(labels[seeds & above])
        for index in seeded[seeded > 0]:
            left, top, width, height, _ = stats[index]
            window = slice(top, top + height), slice(left, left + width)
            part = labels[window] == index
            local, chance = _sharpest(maps, spreads, sign, window, part)
            if not local.any():
                continue
            peaks = _peaks(local, chance)
            mask = np.zeros_like(panel)
            mask[window] = part
            heights = local[peaks[:, 0], peaks[:, 1]].astype(float)
            found.append(Candidate(sign, mask, peaks + np.array([top, left]), heights))
    return found


def _sharpest(
    maps: list[Map], spreads: list[Map], sign: int, window: tuple[slice, slice], part: Mask
) -> tuple[Map, float]:
    """Heights at the finest scale that shows saddles beyond the noise, and that noise."""
    for smooth, spread in zip(maps, spreads, strict=True):
        values = sign * smooth[window]
        local = np.where(part & (values > 0), values, 0).astype(np.float32)
        chance = float(np.median(spread[window][part]))
        if SIGNIFICANT * chance < _SADDLE * local.max():
            break
    return local, chance


def _peaks(values: Map, noise: float) -> NDArray[np.intp]:
    """Maxima that stand out by their saddles, shape (n, 2), the highest first."""
    top = cv2.dilate(values, np.ones((5, 5), np.uint8))
    at = np.argwhere((values == top) & (values > 0.25 * values.max()))
    order = np.argsort(-values[at[:, 0], at[:, 1]], kind='stable')
    at = at[order][:12]
    if len(at) < 2:
        return at
    heights = values[at[:, 0], at[:, 1]]
    kept = [0]
    saddles = np.zeros((len(at), len(at)))
    for level in np.linspace(0, 1, _LEVELS, endpoint=False) * heights[0]:
        _, labels = cv2.connectedComponents((values > level).astype(np.uint8))
        place = labels[at[:, 0], at[:, 1]]
        saddles[(place[:, None] == place[None]) & (place[:, None] > 0)] = level
    step = heights[0] / _LEVELS
    for index in range(1, len(at)):
        drop = heights[index] - saddles[index, kept].max() - step
        if drop > max(_SADDLE * heights[index], SIGNIFICANT * noise):
            kept.append(index)
    return at[kept]
