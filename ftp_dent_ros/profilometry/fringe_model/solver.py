"""The one solver: residual, weights, window sums, the clearest window, update."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from ftp_dent_ros.cloud.response import OF_NOISE
from ftp_dent_ros.profilometry.fringe_model.bins import ROUNDING, WIDTH, BinGrid, moved
from ftp_dent_ros.profilometry.fringe_model.light import LightNoise
from ftp_dent_ros.profilometry.fringe_model.local_fit import ASIDE, LocalFit, Windows
from ftp_dent_ros.profilometry.fringe_model.surfaces import Surfaces
from ftp_dent_ros.profilometry.fringe_model.waveform import USUAL, Waveform

# Times that the waveform is learned, Gauss-Newton rounds before bins choose their windows, after
# which there is one, and times that the windows' own smoothing is taken off the shift in each.
_LEARNED, _ROUNDS, _SHARPENED = 2, 2, 2
#: Wavelength of which half the depth is there after them, fringes: 1.7 along u, where level and
#: amplitude take a part of it, and 1.3 along v.
RESOLVED = 1.45
# Significance at which a window leaves more than one at its side: it lies across an edge (F test).
_SIGNIFICANCE = 1e-5
# Every how many bins show the waveform's response, and the noise.
_EVERY = 5
# Fringes over which the misfit's scale is the mean.
_SCALE = 4.0
# Residuals beyond which a bin counts less, in scales (Geman and McClure's function).
_REDESCENDS = 2.0


@dataclass(frozen=True, eq=False)
class FringeFit:
    """Level, amplitude and phase of the fringes in each bin, and how well they explain its light.

    Attributes
    ----------
    phase, level, amplitude : ndarray, shape (rows, columns), float32
    residual : ndarray
        Light less the model, over the noise's deviation there, times that at the level.
    scale : ndarray, shape (rows, nodes)
        Mean square of the residuals about.
    wave : ndarray
        F.
    waveform : Waveform
        With its response and blur.
    systematic : ndarray, shape (rows, nodes)
        Variance of what the camera's blur may shift the phase by, radians^2.
    noise : LightNoise
    variance : ndarray, shape (rows, nodes)
        Of the phase, by the residuals, radians^2.
    ratios : tuple of ndarray, shape (rows, nodes)
        Variance of the phase over those of the logarithms of contrast and amplitude.
    """

    phase: NDArray[np.float32]
    level: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    residual: NDArray[np.float32]
    scale: NDArray[np.float32]
    wave: NDArray[np.float32]
    waveform: Waveform
    systematic: NDArray[np.float32]
    noise: LightNoise = field(default_factory=LightNoise)
    variance: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    ratios: tuple[NDArray[np.float32], ...] = ()


class Solver:
    """Fits the model to bins of light.

    Parameters
    ----------
    grid : BinGrid
    light, usable, weight : ndarray, shape (rows, columns), float32
        Of the bins, what share of it is usable, and how much each bin counts.
    """

    def __init__(
        self,
        grid: BinGrid,
        light: NDArray[np.float32],
        usable: NDArray[np.float32],
        weight: NDArray[np.float32],
    ) -> None:
        self.grid, self._light, self._usable, self._weight = grid, light, usable, weight
        self._seen = np.maximum(self._about(usable), 1e-3)
        along_u, along_v = (max(1, round(ASIDE * each)) for each in grid.fringe)
        self._sides = (along_u, 0), (-along_u, 0), (0, along_v), (0, -along_v)
        freedom = grid.bins_in_window
        self._across = np.float32(fdtri(freedom, freedom, 1 - _SIGNIFICANCE))
        self._box = np.ones(grid.half_fringe[::-1], np.uint8)
        # Of noise n fits of three unknowns leave 1 - 6 (1 + 1/2 + ... + 1/2n) / bins.
        self._followed = 6 * sum(1 / n for n in range(1, 2 * OF_NOISE + 1)) / freedom

    def solve(self, surfaces: Surfaces, waveform: Waveform) -> FringeFit:
        """Fit from surfaces whose phase is right to a third of a fringe."""
        fit = self._started(surfaces, waveform)
        for _ in range(_ROUNDS):
            fit, windows, change = self._round(fit)
        rest = change.rest + np.float32(ROUNDING)
        # Windows without most of their light are none to go on from.
        rest[2 * self.grid.window_sums(self._usable) <= 1] = np.inf
        # Detail that these have resolved is no edge.
        fit = self._clearest(fit, rest, surfaces.reference)
        at_nodes = (np.maximum(self.grid.at_nodes(x), 1) for x in (fit.level, fit.amplitude))
        variance, ratios = windows.variances(*at_nodes)
        fit, *_ = self._round(fit, is_robust=True)
        fit = self._unblurred(fit)
        wave, _, residual, precision = self._misfit(fit)
        residual *= np.sqrt(precision)
        scale = self._scale(residual)
        # Light that counts less is not light that is explained worse.
        variance *= self._scale(residual * np.sqrt(self._weight)) * np.float32(
            math.exp(self._followed) / self.grid.bins_in_window
        )
        return replace(
            fit,
            residual=residual,
            scale=scale,
            wave=wave,
            variance=variance,
            ratios=ratios,
        )

    def _started(self, surfaces: Surfaces, waveform) -> FringeFit:
        """The first fit, and the response of the waveform, which numbered surfaces show.

        The phase of the start is smooth. Later ones follow the response as ripples, so that the
        light does not show it any more.
        """
        grid, light, phase = self.grid, self._light, surfaces.phase
        fit = FringeFit(phase, *5 * (light,), waveform, light)
        numbered = grid.repeated(surfaces.known)
        for _ in range(_LEARNED):
            wave, slope = fit.waveform.at(phase, grid.across)
            first = Windows(grid, wave, slope, self._weight).fit(light)
            level, amplitude, shift = (
                grid.at_bins(each) for each in (first.level, first.amplitude, first.slope)
            )
            residual = light - level - amplitude * wave - shift * slope
            fit = replace(fit, level=level, amplitude=amplitude)
            fit = self._learned(fit, numbered, light - residual, residual)
        # As smooth as level and amplitude are: they and the phase show noise alike (eq. 8).
        shift = grid.smooth_nodes(np.clip(first.shift, -1, 1), WIDTH)
        return replace(fit, phase=phase + grid.at_bins(shift))

    def _round(self, fit, is_robust: bool = False):
        """The fit after a round, the windows, and the change that they fit."""
        wave, slope, residual, weight = self._misfit(fit)
        if is_robust:
            in_noise = residual * np.sqrt(weight)
            scale = np.maximum(self._scale(in_noise), np.float32(ROUNDING))
            weight *= _redescending(in_noise * in_noise, self.grid.at_bins(scale))
        weight *= self._weight
        slope *= fit.amplitude
        windows = Windows(self.grid, wave, slope, weight)
        change = windows.fit(residual)  # eq. 3
        level, amplitude, shift = self._sharpened(windows, change, weight)
        np.clip(shift, -1, 1, out=shift)
        for each, more in ((level, fit.level), (amplitude, fit.amplitude), (shift, fit.phase)):
            each += more
        return replace(fit, phase=shift, level=level, amplitude=amplitude), windows, change

    def _unblurred(self, fit) -> FringeFit:
        """The fit without half of what the camera's blur may shift it by (eq. 15).

        The camera's blur shifts fringes to where the light is brighter, and where their width
        changes; the projector's does not. Nothing shows which of them blurs more than usual.
        """
        level, amplitude, phase = (
            self.grid.at_nodes(each) for each in (fit.level, fit.amplitude, fit.phase)
        )
        # The blur takes of the amplitude, too, most where the fringes are narrow.
        light = np.log(np.maximum(level, 1) * np.maximum(amplitude, 1))
        light, turn = (np.gradient(each, axis=1) for each in (light, phase))
        fall = self.grid.smooth_nodes(light * turn + np.gradient(turn, axis=1), 2 * WIDTH)
        fall /= 2 * self.grid.smooth_nodes(turn * turn, 2 * WIDTH)
        across = np.linspace(-0.5, 0.5, level.shape[1], dtype=np.float32)
        variance = fit.waveform.variance + fit.waveform.rise * across
        shift = np.maximum(variance - np.float32(USUAL), 0) * fall
        phase = fit.phase - self.grid.at_bins(shift) / 2
        return replace(fit, phase=phase, systematic=shift * shift / 12)

    def _misfit(self, fit):
        """F, its derivative, the light less the model (eq. 1), and the noise's precision there."""
        wave, slope = fit.waveform.at(fit.phase, self.grid.across)
        model = fit.level + fit.amplitude * wave
        return wave, slope, self._light - model, fit.noise.precision(model, fit.level)

    def _sharpened(self, windows: Windows, fit: LocalFit, weight) -> list[NDArray[Any]]:
        """Level, amplitude and shift of the bins without the windows' own smoothing of them."""
        weight = self.grid.at_nodes(weight)
        share = 1 / np.maximum(windows.weight, np.finfo(np.float32).eps)
        sharpened = []
        for smooth in (fit.level, fit.amplitude, fit.slope):
            sharp = smooth
            for _ in range(_SHARPENED):
                sharp = sharp + smooth - self.grid.smooth_nodes(weight * sharp, WIDTH) * share
            sharpened.append(self.grid.at_bins(sharp))
        return sharpened

    def _scale(self, residual) -> Any:
        """Mean square of the residuals about the nodes."""
        size = self._about(self._usable * np.abs(residual)) / self._seen
        # Of a Gaussian, by its mean absolute value.
        return np.float32(np.pi / 2) * size * size

    def _learned(self, fit, numbered, model, residual) -> FringeFit:
        """The fit with response and noise as every few bins together show them (eqs. 4, 5)."""
        scale = self.grid.at_bins(np.maximum(self._scale(residual), np.float32(ROUNDING)))
        phase, level, amplitude, weight, numbered, model, residual, scale = (
            each[::_EVERY, ::_EVERY].ravel()
            for each in (
                fit.phase,
                fit.level,
                fit.amplitude,
                self._weight,
                numbered,
                model,
                residual,
                scale,
            )
        )
        in_noise = np.square(residual) * fit.noise.precision(model, level)
        weight = weight * (numbered & (amplitude > 1)) * _redescending(in_noise, scale)
        size = np.maximum(amplitude, 1)
        waveform = fit.waveform.corrected(phase, residual / size, weight * size * size)
        return replace(fit, waveform=waveform, noise=LightNoise.of(model, residual, weight, scale))

    def _clearest(self, fit, rest, reference):
        """For each bin the fit of the window that explains its light best (eq. 6).

        A window must explain its own light as well: one across an edge does not. From windows at
        the sides the phase goes on in a straight line.
        """
        step, (height, width) = self.grid.node, self.grid.shape
        beside = np.minimum.reduce([moved(rest, round(u / step), v) for u, v in self._sides])
        across = self.grid.repeated(rest > self._across * beside)
        if not across.any():
            return fit
        # What the boxes of bins across an edge hold.
        near = np.flatnonzero(cv2.dilate(across.view(np.uint8), self._box, iterations=2))
        row, column = np.divmod(near, width)
        across, light, weight = (
            each.ravel()[near] for each in (across, self._light, self._weight)
        )
        ahead, place = reference.ravel()[near], self.grid.across[column]
        rest = self.grid.repeated(rest).ravel()
        fitted = [each.ravel() for each in (fit.level, fit.amplitude, fit.phase - reference)]
        misfit = np.zeros((height, width), np.float32)

        def misfit_of(level, amplitude, away, rest):
            wave, _ = fit.waveform.at(ahead + away, place)
            np.put(misfit, near, weight * np.square(light - level - amplitude * wave))
            # Of the boxes that hold a bin the clearest: at an edge that on its side.
            return cv2.erode(self.grid.around(misfit), self._box).ravel()[near] + rest

        best = [each[near] for each in fitted]
        level, amplitude, away = best
        least = misfit_of(level, amplitude, away, rest[near])
        for u, v in self._sides:
            there, beyond = (
                np.clip(row + k * v, 0, height - 1) * width + np.clip(column + k * u, 0, width - 1)
                for k in (1, 2)
            )
            level, amplitude, away = (each[there] for each in fitted)
            away = 2 * away - fitted[2][beyond]
            misfits = misfit_of(level, amplitude, away, rest[there])
            better = across & (misfits < least)
            np.copyto(least, misfits, where=better)
            for new, old in zip((level, amplitude, away), best, strict=True):
                np.copyto(old, new, where=better)
        level, amplitude, phase = fit.level.copy(), fit.amplitude.copy(), fit.phase.copy()
        best[2] += ahead
        for each, values in zip((level, amplitude, phase), best, strict=True):
            np.put(each, near, values)
        return replace(fit, level=level, amplitude=amplitude, phase=phase)

    def _about(self, bins) -> NDArray[Any]:
        along_u, along_v = self.grid.fringe
        size = round(_SCALE * along_u / self.grid.node), round(_SCALE * along_v)
        return cv2.blur(self.grid.at_nodes(bins), size)


def _redescending(square: NDArray[np.float32], scale: NDArray[np.float32]) -> NDArray[Any]:
    """Weights of squared residuals (eq. 5)."""
    return 1 / np.square(1 + square / (np.float32(_REDESCENDS**2) * scale))
