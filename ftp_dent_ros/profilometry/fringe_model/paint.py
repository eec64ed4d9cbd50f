"""Paint whose edges lie in many windows: the albedo where it leaps, divided out of the light.

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
from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, ROWS, WIDTH, BinGrid, dilated
from ftp_dent_ros.profilometry.fringe_model.light import Light
from ftp_dent_ros.profilometry.fringe_model.local_fit import LocalFit
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
    """Divide the albedo out of the light, each time by the phase of the fit before.

    Parameters
    ----------
    fit : callable
        The first fit to a light.

    Returns
    -------
    light : Light
        That of skin of the mean albedo, if the first fit to it leaves less than half of what the
        one before left in a window, in the geometric mean; otherwise the given one.
    start : Start
        The first fit to it.
    """
    cells = replace(grid, step=min(grid.step, ROWS[0]), rows=ROWS[0])
    lit = start.own.swing > FAINTEST
    if not lit.any():
        return light, start
    fine = (light if cells == grid else Light.of(photograph, cells, light.has_stripe)).unbroken
    black = _black_level(start.amplitude[lit], start.level[lit], fine)
    fine, fitted = fine - black, replace(start, level=start.level - black)
    inside = _in_cells(grid, cells, (~grid.within(~lit, 2 * WIDTH)).astype(np.float32)) > 0.5
    for off in _OFF:
        fringes = _Fringes.of(grid, cells, fitted, fine)
        edges = [_edges(cells, fringes, axis, inside, off) for axis in (1, 0)]
        either = np.pad(edges[0], ((0, 0), (1, 0))) | np.pad(edges[1], ((1, 0), (0, 0)))
        near = dilated(either, *(math.ceil(2 * WIDTH * n) for n in cells.fringe[::-1]))
        # Where fewer are wrong, the windows at their sides serve, in less time.
        if 3 * np.count_nonzero(near & inside) <= np.count_nonzero(inside):
            return light, start
        paint = _integral([_leaps(fringes, axis, edges[1 - axis]) for axis in (1, 0)])
        albedo = np.exp(paint - paint[inside].mean())
        shown = Light.of(photograph, grid, light.has_stripe, cells.at_pixels(albedo), black)
        fitted = fit(shown)
    if _unexplained(fitted.own, lit) > _unexplained(start.own, lit) - math.log(2):
        return light, start
    # An edge may lie anywhere in the cells beside, of an even distribution: the light is off by
    # so much of its level there. Elsewhere it is read to one grey level.
    edge: Any = cv2.morphologyEx(paint, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    off = np.square(grid.binned(cells.at_pixels(edge)) * shown.grey.mean()) / 12
    return replace(shown, certain=1 / (1 + off)), fitted


def _unexplained(fit: LocalFit, lit: NDArray[np.bool_]) -> float:
    """Logarithm of the light that a fit leaves, over that of its fringes, the mean of windows."""
    return float(np.log((fit.rest + ROUNDING) / np.maximum(fit.swing, FAINTEST) ** 2)[lit].mean())


def _black_level(
    amplitude: NDArray[np.float32], level: NDArray[np.float32], light: NDArray[np.float32]
) -> float:
    """Grey level that the camera shows of no light: on a line, where the amplitude is zero.

    Windows of edges show less amplitude, which makes the level too high; but no light is darker.
    """
    (spread, both), _ = np.cov(amplitude, level, bias=True)
    least = level.mean() - amplitude.mean() * both / max(spread, FAINTEST**2)
    return float(np.clip(least, 0, np.percentile(light[_FEW], 1)))


def _in_cells(grid: BinGrid, cells: BinGrid, nodes: NDArray[np.float32]) -> NDArray[np.float32]:
    return grid.at_bins(nodes) if cells == grid else cells.binned(grid.at_pixels(nodes))


@dataclass(frozen=True, eq=False)
class _Fringes:
    """Fringes in cells.

    Attributes
    ----------
    light, about : ndarray, shape (rows, columns), float32
        Of the photograph, and its range within half a fringe.
    fitted, phase : ndarray, shape (rows, columns), float32
        Light of the fringes over their level, and their phase.
    """

    light: NDArray[np.float32]
    about: NDArray[np.float32]
    fitted: NDArray[np.float32]
    phase: NDArray[np.float32]

    @classmethod
    def of(
        cls, grid: BinGrid, cells: BinGrid, start: Start, light: NDArray[np.float32]
    ) -> _Fringes:
        """Fringes as the first fit has them, of a smooth contrast."""
        box = np.ones(cells.half_fringe[::-1], np.uint8)
        about = cv2.morphologyEx(light, cv2.MORPH_GRADIENT, box)
        level, swing = (
            grid.smooth_nodes(each, 2 * WIDTH) for each in (start.level, start.amplitude)
        )
        level = np.maximum(level, 2 * FAINTEST)
        contrast = np.minimum(swing, level - FAINTEST) / level
        phase = _in_cells(grid, cells, start.phase)
        fitted = np.cos(phase)
        fitted *= _in_cells(grid, cells, contrast)
        fitted += 1
        return cls(light, np.maximum(about, np.float32(2 * FAINTEST)), fitted, phase)


def _edges(
    cells: BinGrid, fringes: _Fringes, axis: int, inside: NDArray[np.bool_], off: float
) -> NDArray[np.bool_]:
    """Where the light leaps from cell to cell along an axis.

    By more than what the phase, so much off, makes of fringes of the light's range about.
    """
    (before, after), (dark, bright), (first, last), most = (
        _neighbours(each, axis)
        for each in (fringes.light, fringes.fitted, fringes.phase, fringes.about)
    )
    within = np.logical_and(*_neighbours(inside, axis))
    beyond = 2 * np.abs(after * dark - before * bright) / (dark + bright)
    turn = np.abs(last - first) + np.float32(1 / (WIDTH * cells.fringe[1 - axis]))
    noise = _SURE * deviation(beyond[_FEW][within[_FEW]])
    edge = beyond > np.fmax(np.float32(off / 2) * turn * np.maximum(*most), np.float32(noise))
    edge = cv2.dilate(edge.view(np.uint8), np.ones((1, 3) if axis else (3, 1), np.uint8)) > 0
    return edge & within


def _leaps(fringes: _Fringes, axis: int, edge: NDArray[np.bool_]) -> Leaps:
    """Leaps of the albedo's logarithm from cell to cell along an axis, and their weights.

    In troughs of fringes, which have hardly any of the range about, leaps have hardly any weight.
    """
    before, after = _neighbours(np.maximum(fringes.light, np.float32(FAINTEST)), axis)
    (dark, bright), most = (_neighbours(x, axis) for x in (fringes.fitted, fringes.about))
    leap = np.zeros_like(before)
    leap[edge] = np.log(after[edge] * dark[edge] / (before[edge] * bright[edge]))
    darker = np.square(np.minimum(before, after))
    weight = darker / (darker + np.square(np.float32(DEVIATION / 2) * np.maximum(*most)))
    return leap, weight


def _neighbours(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Each value but the last, and the one behind it."""
    return (values[:, :-1], values[:, 1:]) if axis else (values[:-1], values[1:])


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
