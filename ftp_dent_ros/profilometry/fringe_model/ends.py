"""Where the light ends: where it is better explained by that beyond than by fringes that go on."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, WIDTH, BinGrid, Nearest
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.start import Start
from ftp_dent_ros.profilometry.lit_area import PARALLEL, LitArea

# Fringes from an end within which a window sees both sides: two of its standard deviations.
_ACROSS = 2 * WIDTH
# Fringes beyond a surface within which its light ends, and from which on it is dark in any blur.
_BEYOND = 3.0
# Of the rows: the panel's rim ends most of them, and a step's edge crosses most.
_MOST = 0.5
# Fringes that a step has at most: behind a deeper one there is less than half the light. Fringes
# along its edge over which dirt may hide it.
_DEEPEST, _GAP = 10, 6.0


def lit_bins(
    grid: BinGrid,
    light: Light,
    start: Start,
    surface: NDArray[np.bool_],
    reference: NDArray[np.float32],
    phase: NDArray[np.float32],
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Bins between the ends of the light, and the phase that goes on from inside to there.

    Parameters
    ----------
    surface : ndarray of bool, shape (rows, nodes)
        Where fringes are numbered.
    reference, phase : ndarray, shape (rows, columns)
        Phase of smooth surfaces that go on beyond their ends, and that of the first fit, radians.
    """
    inner, near = (
        how(surface.view(np.uint8), _box(grid, fringes)) > 0
        for how, fringes in ((cv2.erode, _ACROSS), (cv2.dilate, _BEYOND))
    )
    from_inside = Nearest(inner)
    away, level, amplitude = (
        grid.at_bins(from_inside(each))
        for each in (grid.at_nodes(phase - reference), start.level, start.amplitude)
    )
    onwards = reference + away
    beyond = grid.at_bins(Nearest(~near)(start.level))
    fringes = np.square(light.unbroken - level - amplitude * np.cos(onwards))
    gain = light.usable * (np.square(light.unbroken - beyond) - fringes)
    gain = np.where(grid.repeated(near), gain, 0) - np.float32(ROUNDING)
    wide, high = (2 * math.ceil(each / 2) + 1 for each in grid.fringe)
    lit = _stretches(gain, high) & _stretches(gain.T, wide).T
    return lit, np.where(grid.repeated(inner), phase, onwards)


def led_to_ends(
    grid: BinGrid,
    lit: NDArray[np.bool_],
    fitted: NDArray[np.bool_],
    reference: NDArray[np.float32],
    phase: NDArray[np.float32],
) -> NDArray[np.float32]:
    """A fit's phase, led on from inside where its windows see bins beyond the light's end.

    Parameters
    ----------
    lit, fitted : ndarray of bool, shape (rows, columns)
        Bins between the ends of the light, and those that the fit has weighed.
    reference, phase : ndarray, shape (rows, columns)
        Phase of smooth surfaces, and that of the fit, radians.
    """
    dark, whole = fitted & ~lit, lit.reshape(*grid.node_shape, grid.node).all(axis=2)
    across = cv2.dilate(grid.at_nodes(dark.astype(np.float32)), _box(grid, _ACROSS)) > 0
    away = Nearest(whole & ~across)(grid.at_nodes(phase - reference))
    return np.where(grid.repeated(across), reference + grid.at_bins(away), phase)


def beyond_steps(
    grid: BinGrid, area: LitArea, edges: NDArray[np.bool_], phase: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Nodes that may lie behind a step of whole fringes, which the phase does not show.

    Behind one the light ends whole fringes before the panel's rim. The step is at an edge that
    most rows cross; the first from the stripe on may be it.

    Parameters
    ----------
    grid : BinGrid
    area : LitArea
    edges : ndarray of bool, shape (rows, nodes)
    phase : ndarray, shape (rows, nodes)
        Absolute, if there is no step, radians.
    """
    beyond = np.zeros(edges.shape, bool)
    rows = area.lit.any(axis=1)
    for last, (away, share) in area.columns.items():
        outwards = phase if last else -phase
        first = np.where(edges & (outwards > 0), outwards, np.inf).min(axis=1)
        shown = min(share, np.isfinite(first[rows]).mean()) > _MOST
        if shown and 0 < round(away) <= _DEEPEST and abs(away - round(away)) < PARALLEL:
            first = ndimage.minimum_filter1d(first, math.ceil(_GAP * grid.fringe[1]))
            beyond |= outwards > first[:, None]
    return beyond


def _stretches(gain: NDArray[np.float32], across: int) -> NDArray[np.bool_]:
    """In each row the bins from one to another whose sum is the largest: the likeliest ends.

    Rows are taken `across` at a time, as dark fringes tell no end.
    """
    rows: Any = cv2.blur(np.ascontiguousarray(gain), (1, across))
    total = np.pad(np.cumsum(rows, axis=1, dtype=float), ((0, 0), (1, 0)))
    lowest = np.minimum.accumulate(total, axis=1)
    last = (total - lowest).argmax(axis=1)[:, None]
    first = (total == np.take_along_axis(lowest, last, axis=1)).argmax(axis=1)[:, None]
    bins = np.arange(gain.shape[1])
    within: Any = ((bins >= first) & (bins < last)).view(np.uint8)
    return cv2.dilate(within, np.ones((across, 1), np.uint8)) > 0


def _box(grid: BinGrid, fringes: float) -> NDArray[np.uint8]:
    """So many fringes to each side, in nodes."""
    along_u, along_v = grid.fringe
    return np.ones(
        [2 * math.ceil(fringes * n) + 1 for n in (along_v, along_u / grid.node)], np.uint8
    )
