"""The waveform F of the projected fringes over the panel's phase, blur and response included.

F is the pattern's light about its mean, blurred by a Gaussian whose variance is a plane over the
picture, plus the harmonics 2 to 5 that the projector's and the camera's response add. Both are
global unknowns of the fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern

_TURN = 2 * math.pi
# Samples a fringe: between them F follows its slope, wrong by (pi / 128)^2 / 2 at most.
_SAMPLES = 128
# Fringes beyond the panel's ends.
_BEYOND = 4
# Variances of the blur with a table, radians^2; the largest leaves a tenth of the fringes.
_VARIANCES = np.arange(0.06, 4.6, 0.15)
_HARMONICS = range(2, 6)
# Variances to choose from at first, so near that the fit finds the way.
_FIRST = 0.3, 1.0, 2.0, 3.0, 4.0
#: Variance of the blur to begin with, radians^2: a pixel and half a pixel of fringes 10 wide.
USUAL = 0.3


@dataclass(frozen=True, eq=False)
class Waveform:
    """F, its derivative by the phase, and by the blur's variance.

    Attributes
    ----------
    start : float
        Phase of the tables' first sample, radians.
    tables : ndarray, shape (3, blurs, samples), float32
        F, dF / d phase, dF / d variance.
    harmonics : ndarray, shape (8,)
        Cosine and sine parts of the harmonics 2 to 5, over the fundamental.
    """

    start: float
    tables: NDArray[np.float32]
    harmonics: NDArray[np.float64]

    @classmethod
    def of(cls, pattern: Pattern) -> Waveform:
        """Waveform of a pattern's light as even projector pixels show it."""
        orders = pattern.fringe_orders
        count = (len(orders) + 2 * _BEYOND) * _SAMPLES
        start = _TURN * (orders.start - _BEYOND - 0.25)
        phase = start + _TURN / _SAMPLES * np.arange(count)
        light = np.fft.rfft(_drawn(pattern, phase)) / np.sinc(1 / pattern.period_px)
        frequency = np.fft.rfftfreq(count, _TURN / _SAMPLES) * _TURN
        # A plain cosine keeps its form in every blur.
        blurs = _VARIANCES if pattern.code == 'contrast' else [USUAL]
        tables = np.empty((3, len(blurs), count), np.float32)
        for level, variance in enumerate(blurs):
            # Over the carrier's own loss, which is the amplitude's.
            half = (1 - np.square(frequency)) / 2
            blurred = light * np.exp(variance * half)
            for table, spectrum in zip(
                tables[:, level], (blurred, 1j * frequency * blurred, half * blurred), strict=True
            ):
                table[:] = np.fft.irfft(spectrum, count)
        return cls(start, tables, np.zeros(2 * len(_HARMONICS)))

    @property
    def variances(self) -> tuple[float, ...]:
        """Variances of the blur to begin with, radians^2."""
        return _FIRST if self.has_code else (USUAL,)

    @property
    def has_code(self) -> bool:
        """Whether fringes differ, so that the blur changes more than their amplitude."""
        return self.tables.shape[1] > 1

    def at(
        self, phase: NDArray[np.float32], variance: NDArray[np.float32] | float = USUAL
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """F, dF / d phase and dF / d variance at phases, for blurs of variances (radians^2)."""
        _, blurs, count = self.tables.shape
        place = phase * np.float32(_SAMPLES / _TURN)
        place -= np.float32(self.start * _SAMPLES / _TURN)
        np.clip(np.nan_to_num(place, copy=False), 0, count - 1, out=place)
        index = np.rint(place).astype(np.int32)
        place -= index
        place *= np.float32(_TURN / _SAMPLES)
        if blurs == 1:
            light, slope, by_blur = (each.ravel().take(index) for each in self.tables)
            return light + slope * place, slope, by_blur
        pitch = np.float32(_VARIANCES[1] - _VARIANCES[0])
        level = (variance - np.float32(_VARIANCES[0])) / pitch
        nearest = np.clip(np.rint(level), 0, blurs - 1)
        index += nearest.astype(np.int32) * np.int32(count)
        light, slope, by_blur = (table.ravel().take(index) for table in self.tables)
        return light + slope * place + pitch * (level - nearest) * by_blur, slope, by_blur

    def corrected(
        self,
        phase: NDArray[np.float32],
        misfit: NDArray[np.float32],
        weight: NDArray[np.float32],
    ) -> Waveform:
        """Waveform with the harmonics that a misfit over the amplitude shows (least squares)."""
        columns = np.stack([each.ravel() for _, *pair in _overtones(phase) for each in pair])
        weighted = columns * weight.ravel()
        normal = weighted @ columns.T
        more = np.linalg.solve(
            normal + 1e-9 * max(np.trace(normal), 1e-9) * np.eye(len(normal)),
            weighted @ misfit.ravel(),
        )
        tables = self.tables.copy()
        samples = self.start + _TURN / _SAMPLES * np.arange(tables.shape[2])
        for (order, cosine, sine), (a, b) in zip(
            _overtones(samples), more.reshape(-1, 2), strict=True
        ):
            tables[0] += a * cosine + b * sine
            tables[1] += order * (b * cosine - a * sine)
        return replace(self, tables=tables, harmonics=self.harmonics + more)


def _drawn(pattern: Pattern, phase: NDArray[np.floating]) -> NDArray[np.float64]:
    """Light of the panel's pixels about its mean, -1 to 1, over the samples of a phase.

    Each pixel is even, and of a whole level: rounding shifts fringes by thousandths of them.
    """
    half = (phase[1] - phase[0]) / 2
    ends = pattern.column(np.append(phase - half, phase[-1] + half))
    pixels = np.arange(math.floor(ends[0]) - 1, math.ceil(ends[-1]) + 2)
    on_panel = (pixels >= 0) & (pixels < pattern.width)
    drawn = pattern.draw()[0, np.clip(pixels, 0, pattern.width - 1), 0] / pattern.levels
    light = 2 * np.where(on_panel, drawn, pattern.intensity(pixels)) - 1
    total = np.interp(ends, np.append(pixels, pixels[-1] + 1) - 0.5, np.append(0, light.cumsum()))
    return np.diff(total) / np.diff(ends)


def _overtones(phase):
    """Order, cosine and sine of each harmonic."""
    turn = np.exp(1j * phase)
    power = turn
    for order in _HARMONICS:
        power = power * turn
        yield order, power.real, power.imag
