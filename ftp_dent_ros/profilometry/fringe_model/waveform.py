"""The waveform F of the projected fringes over the panel's phase, blur and response included.

F is the pattern's light about its mean, blurred by a Gaussian, and bent by the projector's and the
camera's response: Chebyshev's polynomials of the orders 2 to 5, which of cosines are harmonics.
Blur and response are one for the whole picture, but for the blur's rise over its width.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.fft import irfft

from ftp_dent_ros.pattern.pattern import Pattern

# Samples a fringe: between them F follows its slope, wrong by (pi / 64)^2 / 2 at most.
_SAMPLES = 64
# Fringes beyond the panel's ends.
_BEYOND = 4
# Polynomials of the response, orders 2 to 5.
_BENDS = 4
# Widths of the blur to choose from, radians: the largest leaves a tenth of the fringes. Factors on
# the chosen width, to choose it better: some half a step.
_WIDTHS, _NEARER = np.linspace(0.3, 2.1, 5), np.array([0.8, 1.0, 1.2])
# Uncertainty of the variance in a third of the picture, over that of its rise beforehand.
_KNOWN = 0.1
#: Variance of the blur where no code shows it: a pixel and half a pixel of fringes 10 wide.
USUAL = 0.3


@dataclass(frozen=True, eq=False)
class Waveform:
    """F, its derivative by the phase, and by the blur's variance.

    Attributes
    ----------
    start : float
        Phase of the first sample, radians.
    spectrum : ndarray, shape (frequencies,)
        Of the panel's light over the samples.
    frequency : ndarray, shape (frequencies,)
        Over the fringes'.
    straight : ndarray, shape (3, samples)
        The blurred light over the samples, its derivative by the phase, and by the variance.
    variance : float
        Of the blur in the middle of the picture, radians^2.
    rise : float
        Of that variance over the picture's width.
    response : ndarray, shape (4,)
        Of the polynomials of the orders 2 to 5, over the fundamental.
    """

    start: float
    spectrum: NDArray[np.complex64]
    frequency: NDArray[np.float32]
    straight: NDArray[np.float32]
    variance: float = USUAL
    rise: float = 0.0
    response: NDArray[np.float64] = field(default_factory=lambda: np.zeros(_BENDS))

    @classmethod
    def of(cls, pattern: Pattern, colour: str = 'red') -> Waveform:
        """Waveform of a colour of a pattern's light as even projector pixels show it."""
        orders = pattern.fringe_orders
        count = (len(orders) + 2 * _BEYOND) * _SAMPLES
        start = math.tau * (orders.start - _BEYOND - 0.25)
        phase = start + math.tau / _SAMPLES * np.arange(count)
        light = _drawn(pattern, phase, ('red', 'green', 'blue').index(colour))
        return cls(
            start,
            (np.fft.rfft(light) / np.sinc(1 / pattern.period_px)).astype(np.complex64),
            np.fft.rfftfreq(count, 1 / _SAMPLES).astype(np.float32),
            np.empty((3, 0), np.float32),
        ).in_blur(USUAL)

    def in_blur(self, variance: float, rise: float = 0.0) -> Waveform:
        """The waveform in a blur of some variance and its rise, radians^2."""
        # Over the carrier's own loss, which is the amplitude's.
        half = (1 - np.square(self.frequency)) / 2
        blurred = self.spectrum * np.exp(np.float32(variance) * half)
        spectra = np.stack([blurred, 1j * self.frequency * blurred, half * blurred])
        straight = irfft(spectra, 2 * (len(self.frequency) - 1))
        return replace(self, straight=straight, variance=variance, rise=rise)

    @cached_property
    def in_blurs(self) -> list[Waveform]:
        """The waveform in the blurs to choose from."""
        return [self.in_blur(each**2) for each in _WIDTHS]

    def least_blur(
        self, left: Callable[[Waveform], NDArray[np.floating]], places: NDArray[np.floating]
    ) -> tuple[float, float]:
        """The blur that leaves least, and its rise: a parabola through the best choices.

        Parameters
        ----------
        left : callable
            Computes what a waveform leaves of the light at the places.
        places : ndarray, shape (places,)
            From -0.5 to 0.5 over the picture's width.
        """
        line = np.vstack([np.column_stack([np.ones(len(places)), places]), [0, _KNOWN]])

        def chosen(variances: NDArray[np.floating]) -> tuple[float, float]:
            (variance, rise), *_ = np.linalg.lstsq(line, np.append(variances, 0), rcond=None)
            return float(max(variance, _WIDTHS[0] ** 2)), float(rise)

        variance, rise = chosen(_lowest(_WIDTHS, [left(each) for each in self.in_blurs]) ** 2)
        nearer = [self.in_blur(each**2 * variance, each**2 * rise) for each in _NEARER]
        factors = _lowest(_NEARER, [left(each) for each in nearer])
        return chosen((variance + rise * places) * factors**2)

    @cached_property
    def tables(self) -> tuple[NDArray[np.float32], ...]:
        """F, dF / d phase, dF / d variance and the straight F at the samples, shape (samples,)."""
        light, slope, by_blur = self.straight
        bent = np.array([0, 1, *self.response], np.float32)
        steep = chebyshev.chebval(light, chebyshev.chebder(bent))
        return chebyshev.chebval(light, bent), steep * slope, steep * by_blur, light

    def at(
        self, phase: NDArray[np.float32], place: NDArray[np.float32] | float = 0.0
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """F and dF / d phase at phases, at places of the picture from -0.5 to 0.5 of its width."""
        light, slope, by_blur, _ = self.tables
        index, beyond = self._nearest(phase)
        slope = slope.take(index, mode='clip')
        wave = light.take(index, mode='clip') + slope * beyond
        if self.rise:
            wave += np.float32(self.rise) * place * by_blur.take(index, mode='clip')
        return wave, slope

    def _nearest(self, phase):
        """Index of the nearest sample, and what the phase is beyond it, radians."""
        turn = _SAMPLES / math.tau
        place = phase * np.float32(turn) - np.float32(self.start * turn)
        nearest = np.rint(place)
        # In two steps it takes half the time.
        return nearest.astype(np.int32).astype(np.intp), (place - nearest) * np.float32(1 / turn)

    def corrected(
        self,
        phase: NDArray[np.float32],
        misfit: NDArray[np.float32],
        weight: NDArray[np.float32],
    ) -> Waveform:
        """The waveform with the response that a misfit shows (eq. 4).

        Parameters
        ----------
        phase, misfit, weight : ndarray, shape (samples,)
            The misfit is over the amplitude.
        """
        straight = self.tables[3].take(self._nearest(phase)[0], mode='clip')
        bends = chebyshev.chebvander(straight, _BENDS + 1).T[2:]
        weighted = bends * weight
        normal = (weighted @ bends.T).astype(float)
        ridge = 1e-9 + 1e-6 * np.trace(normal)
        more = np.linalg.solve(normal + ridge * np.eye(len(normal)), weighted @ misfit)
        return replace(self, response=self.response + more)


def _lowest(
    places: NDArray[np.floating], values: Sequence[NDArray[np.floating]]
) -> NDArray[np.float64]:
    """For each column of values the place of the least: by a parabola through the three about."""
    lowest = []
    for each in np.transpose(values):
        middle = int(np.clip(each.argmin(), 1, len(each) - 2))
        near = slice(middle - 1, middle + 2)
        bend, slope, _ = np.polyfit(places[near], each[near], 2)
        least = -slope / (2 * bend) if bend > 0 else places[each.argmin()]
        lowest.append(np.clip(least, places[0], places[-1]))
    return np.array(lowest)


def _drawn(pattern: Pattern, phase: NDArray[np.floating], colour: int) -> NDArray[np.float64]:
    """Light of the panel's pixels about its mean, -1 to 1, over the samples of a phase.

    Each pixel is even, and of a whole level: rounding shifts fringes by thousandths of them. Rows
    of other contrasts are rounded otherwise: the light is the mean over all of them.
    """
    half = (phase[1] - phase[0]) / 2
    ends = pattern.column(np.append(phase - half, phase[-1] + half))
    pixels = np.arange(math.floor(ends[0]) - 1, math.ceil(ends[-1]) + 2)
    on_panel = (pixels >= 0) & (pixels < pattern.width)
    contrast = pattern.row_contrast(np.arange(pattern.height))
    drawn = ((2 / pattern.levels * pattern.draw()[..., colour] - 1).T / contrast).mean(axis=1)
    drawn = drawn[np.clip(pixels, 0, pattern.width - 1)]
    light = np.where(on_panel, drawn, 2 * pattern.intensity(pixels) - 1)
    total = np.interp(ends, np.append(pixels, pixels[-1] + 1) - 0.5, np.append(0, light.cumsum()))
    return np.diff(total) / np.diff(ends)
