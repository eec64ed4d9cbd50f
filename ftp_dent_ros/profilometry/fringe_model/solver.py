"""The one solver: residual, weights, window sums, the clearest window, update."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ftp_dent_ros.profilometry.fringe_model.bins import BinGrid
from ftp_dent_ros.profilometry.fringe_model.local_fit import fit_windows
from ftp_dent_ros.profilometry.fringe_model.waveform import USUAL, Waveform

# Gauss-Newton rounds, and their over-relaxation (2 and more diverge): what is wider than a window
# is there after two rounds, and of details 1.3 fringes long half the depth at last.
_ROUNDS, _RELAXATION = 7, 1.4
# Fringes from the centred window to those at its sides: an edge between is two deviations off.
_ASIDE = 1.0
# Rounds that choose windows: the first fit is mixed at edges, later ones go on from the choice.
_CHOOSING = 2
# Significance at which a window at the side explains a bin's light better (F test).
_SIGNIFICANCE = 1e-2
# Steps of the waveform's unknowns a round, and every how many bins show them.
_LEARNED, _EVERY = 2, 3
# Fringes over which the misfit's scale is the mean.
_SCALE = 4.0
# Residuals beyond which a bin counts less, in scales (Geman and McClure's function).
_REDESCENDS = 2.0
# Mean square of rounding to whole levels in a bin, levels^2.
_ROUNDING = 0.05
# Least mean weight of a window that may be taken.
_LEAST_WEIGHT = 0.05


@dataclass(frozen=True, eq=False)
class FringeFit:
    """Level, amplitude and phase of the fringes in each bin, and how well they explain its light.

    Attributes
    ----------
    phase, level, amplitude : ndarray, shape (rows, columns), float32
    residual : ndarray
        Light less the model.
    scale : ndarray
        Mean square of the residuals about, by weight.
    weight : ndarray
        0 to 1.
    waveform : Waveform
        With its harmonics.
    blur : ndarray, shape (3,)
        Variance of the blur, radians^2: in the middle, and its rise over the width and height.
    """

    phase: NDArray[np.float32]
    level: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    residual: NDArray[np.float32]
    scale: NDArray[np.float32]
    weight: NDArray[np.float32]
    waveform: Waveform
    blur: NDArray[np.float64]


class Solver:
    """Fits the model to bins of light.

    Parameters
    ----------
    grid : BinGrid
    """

    def __init__(self, grid: BinGrid) -> None:
        self.grid = grid
        along_u, along_v = (max(1, round(_ASIDE * each)) for each in grid.fringe)
        self._sides = (along_u, 0), (-along_u, 0), (0, along_v), (0, -along_v)
        freedom = float(np.prod(grid.half_fringe))
        self._box = np.ones(grid.half_fringe[::-1], np.uint8)
        rows, columns = grid.shape
        y, x = np.mgrid[-0.5 : 0.5 : rows * 1j, -0.5 : 0.5 : columns * 1j].astype(np.float32)
        self._plane = np.stack([np.ones_like(x), x, y])
        self.clear = float(stats.f.isf(_SIGNIFICANCE, freedom, freedom))

    def solve(
        self,
        light: NDArray[np.float32],
        usable: NDArray[np.float32],
        reference: NDArray[np.float32],
        start: FringeFit,
    ) -> FringeFit:
        """Fit from a start, whose phase is right to a third of a fringe."""
        fit, weight = start, usable
        for number in range(_ROUNDS):
            wave, slope, _ = self._wave(fit)
            residual = light - fit.level - fit.amplitude * wave  # eq. 1
            more = fit_windows(self.grid, residual, wave, fit.amplitude * slope, weight)  # eq. 3
            level, amplitude, shift = (
                self.grid.at_bins(each) for each in (more.level, more.amplitude, more.slope)
            )
            shift = np.clip(_RELAXATION * shift, -1, 1)
            level, amplitude = fit.level + level, fit.amplitude + amplitude
            count, rest = self.grid.at_bins(more.weight), self.grid.at_bins(more.rest)
            fitted = level, amplitude, fit.phase + shift - reference
            if number < _CHOOSING:
                fitted = self._clearest(light, usable, fit, fitted, count, rest, reference)
            level, amplitude, away = fitted
            fit = replace(fit, phase=reference + away, level=level, amplitude=amplitude)
            fit, weight = self._weighted(light, usable, fit, weight, number < _ROUNDS - 1)
        return fit

    def _weighted(self, light, usable, fit, weight, learn):
        """The fit with its global unknowns, residuals and weights (eq. 4 and 5)."""
        if learn:
            fit = self._learned(light, weight, fit)
        wave, *_ = self._wave(fit)
        residual = light - fit.level - fit.amplitude * wave
        square = residual * residual
        size = self._about(usable * np.abs(residual)) / np.maximum(self._about(usable), 1e-3)
        scale = np.float32(np.pi / 2) * size * size  # of a Gaussian, by its mean absolute value
        limit = _REDESCENDS**2 * np.maximum(scale, _ROUNDING)
        weight = usable / np.square(1 + square / limit)
        return replace(fit, residual=residual, scale=scale, weight=weight), weight

    def _learned(self, light, weight, fit):
        """The fit with the waveform's unknowns as every few bins together show them."""
        phase, level, amplitude, light, weight, *plane = (
            np.ascontiguousarray(each[::_EVERY, ::_EVERY])
            for each in (fit.phase, fit.level, fit.amplitude, light, weight, *self._plane)
        )
        waveform, blur = fit.waveform, fit.blur
        size = np.maximum(amplitude, 1)
        weight = np.where(amplitude > 1, weight * size * size, 0)
        for _ in range(_LEARNED):
            wave, _, by_blur = waveform.at(phase, np.tensordot(blur, plane, axes=1))
            misfit = (light - level - amplitude * wave) / size
            if waveform.has_code:
                blur = blur + _more_blur(misfit, by_blur * np.stack(plane), weight)
            waveform = waveform.corrected(phase, misfit, weight)
        return replace(fit, waveform=waveform, blur=blur)

    def _wave(self, fit):
        has_code = fit.waveform.has_code
        variance = np.tensordot(fit.blur, self._plane, axes=1) if has_code else USUAL
        return fit.waveform.at(fit.phase, variance)

    def _clearest(self, light, usable, fit, fitted, count, rest, reference):
        """For each bin the fit of the window that explains its light best (eq. 6).

        A window must explain its own light as well: one across an edge does not. From windows at
        the sides the phase goes on in a straight line.
        """

        def misfit_of(level, amplitude, away):
            wave, *_ = self._wave(replace(fit, phase=reference + away))
            square = usable * np.square(light - level - amplitude * wave)
            # Of the boxes that hold a bin the clearest: at an edge that on its side.
            return cv2.erode(self.grid.around(square), self._box) + _ROUNDING

        best, least = fitted, misfit_of(*fitted) + rest
        limit = least / self.clear
        for u, v in self._sides:
            level, amplitude, away = (_moved(each, u, v) for each in fitted)
            away = 2 * away - _moved(fitted[2], 2 * u, 2 * v)
            misfit = misfit_of(level, amplitude, away) + _moved(rest, u, v)
            better = (misfit < np.minimum(limit, least)) & (_moved(count, u, v) > _LEAST_WEIGHT)
            least = np.where(better, misfit, least)
            moved = level, amplitude, away
            best = [np.where(better, new, old) for new, old in zip(moved, best, strict=True)]
        return best

    def _about(self, bins):
        width, height = (round(_SCALE * each) for each in self.grid.fringe)
        return cv2.blur(bins, (width, height))


def _more_blur(misfit, terms, weight):
    """What the misfit says of the blur's plane (least squares), a radian^2 at most."""
    terms = terms.reshape(3, -1)
    weighted = terms * weight.ravel()
    normal = weighted @ terms.T
    ridge = 1e-6 * float(np.trace(normal)) * np.eye(3)
    return np.clip(np.linalg.solve(normal + ridge, weighted @ misfit.ravel()), -1, 1)


def _moved(bins, columns, rows):
    """The value of the bin so far to the right and below, at the border the border's."""
    move = np.array([[1, 0, -columns], [0, 1, -rows]], np.float32)
    size = bins.shape[::-1]
    return cv2.warpAffine(
        bins, move, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
    )
