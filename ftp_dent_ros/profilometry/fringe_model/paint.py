"""Paint whose edges lie in most windows: the albedo where it leaps, divided out of the light.

Fringes change the light slowly, printed squares and letters at once. What the light's logarithm
leaps by, and fringes cannot, are the albedo's gradients (eq. 13).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from scipy.sparse.linalg import LinearOperator, cg

from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, ROWS, WIDTH, BinGrid
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.start import DEVIATION, FAINTEST, Start
from ftp_dent_ros.robust import deviation

# What the phase may be off in each round, radians: at first anything.
_OFF = 1.0, DEVIATION, DEVIATION, DEVIATION
# Standard deviations that a leap exceeds: noise does so in one of 16,000 cells.
_SURE = 4.0
# Cells that show noise.
_FEW = np.s_[::3, ::3]
# Steps of conjugate gradients to the albedo: boards are measured no better after forty.
_STEPS = 12

Leaps = tuple[NDArray[np.float32], NDArray[np.float32]]


def divide_paint(
    photograph: Photograph,
    grid: BinGrid,
    light: Light,
    start: Start,
    fit: Callable[[Light], Start],
) -> tuple[Light, Start]:
    """Divide the albedo out of the light, as often as the phase gets surer by that.

    Parameters
    ----------
    fit : callable
        The first fit to a light.

    Returns
    -------
    light : Light
        That of skin of the mean albedo; the given one unless edges of paint lie within half a
        fringe of most of it.
    start : Start
        The first fit to it.
    """
    cells = replace(grid, step=min(grid.step, ROWS[0]), rows=ROWS[0])
    lit = start.own.swing > FAINTEST
    if not lit.any():
        return light, start
    fine = light.unbroken
    if cells != grid:
        fine = Light.of(photograph, cells, light.has_stripe).unbroken
    inside = _in_cells(grid, cells, (~grid.within(~lit, 2 * WIDTH)).astype(np.float32)) > 0.5
    for off in _OFF:
        leaps = _leaps(cells, fine, _Fringes.of(grid, cells, start), inside, off)
        if not _lie_in_most_windows(cells, leaps, inside):
            break
        paint = _integral(leaps)
        paint -= paint[inside].mean()
        shown = Light.of(photograph, grid, light.has_stripe, cells.at_pixels(np.exp(paint)))
        found = fit(shown)
        if _doubt(found, lit) > _doubt(start, lit):
            break
        light, start = shown, found
    return light, start


def _doubt(start: Start, lit: NDArray[np.bool_]) -> float:
    """Mean logarithm of the phase's variance, but for a constant."""
    rest, swing = np.maximum(start.own.rest, ROUNDING), np.maximum(start.own.swing, FAINTEST)
    return float(np.log(rest / np.square(swing))[lit].mean())


def _in_cells(grid: BinGrid, cells: BinGrid, nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    return grid.at_bins(nodes) if cells == grid else cells.binned(grid.at_pixels(nodes))


@dataclass(frozen=True, eq=False)
class _Fringes:
    """Fringes in cells: their light over their level, and their phase."""

    light: NDArray[np.float32]
    phase: NDArray[np.float32]

    @classmethod
    def of(cls, grid: BinGrid, cells: BinGrid, start: Start) -> _Fringes:
        """Fringes as the first fit has them, of a smooth contrast."""
        level, swing = (
            grid.smooth_nodes(each, 2 * WIDTH) for each in (start.own.level, start.own.swing)
        )
        level = np.maximum(level, 2 * FAINTEST)
        contrast = np.minimum(swing, level - FAINTEST) / level
        phase = _in_cells(grid, cells, start.phase)
        light = np.cos(phase)
        light *= _in_cells(grid, cells, contrast)
        light += 1
        return cls(light, phase)


def _leaps(
    cells: BinGrid,
    light: NDArray[np.float32],
    fringes: _Fringes,
    inside: NDArray[np.bool_],
    off: float,
) -> list[Leaps]:
    """Leaps of the albedo's logarithm from cell to cell along u and along v, and their weights.

    A leap is more than what the phase, so much off, makes of fringes of the light's range about.
    In their troughs, which have hardly any of this range, leaps have hardly any weight.
    """
    box = np.ones(cells.half_fringe[::-1], np.uint8)
    about = np.maximum(cv2.dilate(light, box) - cv2.erode(light, box), np.float32(2 * FAINTEST))
    leaps = []
    fields = light, fringes.light, fringes.phase, about
    for axis, fringe in ((1, cells.fringe[0]), (0, cells.fringe[1])):
        (before, after), (dark, bright), (first, last), (lower, upper) = (
            _neighbours(each, axis) for each in fields
        )
        within = np.logical_and(*_neighbours(inside, axis))
        beyond = np.abs(after - before - (after + before) * (bright - dark) / (bright + dark))
        most = np.maximum(lower, upper)
        turn = np.abs(last - first) + np.float32(1 / (WIDTH * fringe))
        noise = _SURE * deviation(beyond[_FEW][within[_FEW]])
        edge = beyond > np.fmax(np.float32(off / 2) * turn * most, np.float32(noise))
        edge = cv2.dilate(edge.view(np.uint8), np.ones((1, 3) if axis else (3, 1), np.uint8)) > 0
        edge &= within
        leap = np.zeros_like(beyond)
        before, after = (np.maximum(each, np.float32(FAINTEST)) for each in (before, after))
        leap[edge] = np.log(after[edge] * dark[edge] / (before[edge] * bright[edge]))
        darker = np.square(np.minimum(before, after))
        weight = darker / (darker + np.square(np.float32(DEVIATION / 2) * most))
        leaps.append((leap, weight))
    return leaps


def _neighbours(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Each value but the last, and the one behind it."""
    return (values[:, :-1], values[:, 1:]) if axis else (values[:-1], values[1:])


def _lie_in_most_windows(cells: BinGrid, leaps: list[Leaps], inside: NDArray[np.bool_]) -> bool:
    """Whether edges are within half a fringe of most cells."""
    edges = np.zeros(inside.shape, np.uint8)
    (across, _), (down, _) = leaps
    edges[:, 1:] |= across != 0
    edges[1:] |= down != 0
    high, wide = (2 * math.ceil(n * WIDTH) + 1 for n in cells.fringe[::-1])
    near = cv2.dilate(edges, np.ones((high, wide), np.uint8)) > 0
    return 2 * np.count_nonzero(near & inside) > np.count_nonzero(inside)


def _integral(leaps: list[Leaps]) -> NDArray[np.float32]:
    """Values whose differences from cell to cell are the leaps, by weighted least squares."""
    (across, of_u), (down, of_v) = leaps
    shape = len(across), len(down[0])
    bend = [2 - 2 * np.cos(np.pi * np.arange(n, dtype=np.float32) / n) for n in shape]
    bends = np.add.outer(*bend)
    bends[0, 0] = 1

    def divergence(along_u, along_v):
        sums = np.zeros(shape, np.float32)
        sums[:, :-1] -= along_u
        sums[:, 1:] += along_u
        sums[:-1] -= along_v
        sums[1:] += along_v
        return sums.ravel()

    def normal(values):
        values = values.reshape(shape)
        return divergence(of_u * np.diff(values, axis=1), of_v * np.diff(values, axis=0))

    def even(sums):
        # Exact where all weights are one.
        return idctn(dctn(sums.reshape(shape)) / bends).ravel()

    size = math.prod(shape)
    of = {'shape': (size, size), 'dtype': np.float32}
    operator, inverse = LinearOperator(matvec=normal, **of), LinearOperator(matvec=even, **of)
    sums = divergence(of_u * across, of_v * down)
    values: Any = cg(operator, sums, maxiter=_STEPS, M=inverse)[0]
    return values.reshape(shape)
