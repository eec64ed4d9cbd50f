"""Where the light ends: where it is better explained by that beyond than by fringes that go on."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, WIDTH, BinGrid, Nearest
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.start import Start

# Fringes from an end within which a window sees both sides: two of its standard deviations.
_ACROSS = 2 * WIDTH
# Fringes beyond a surface within which its light ends, and from which on it is dark in any blur.
_BEYOND = 3.0


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
