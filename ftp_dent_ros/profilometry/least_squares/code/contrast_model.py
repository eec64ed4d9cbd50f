"""What the contrast of coded fringes looks like through the blur of projector, camera and bins.

Fringes that are as bright as the projector's even pixels, blurred by a Gaussian of a variance
s^2 (radians^2 of phase), are M(Phi), and a small shift adds -dM/dPhi. Both are what cosine and
sine become, as the complex number e^(i Phi), by an envelope z(Phi) that passes smoothly, and
slightly turned, from one fringe's contrast to the next. Without it a shift would be seen wherever
the contrast changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.windows import WIDTH

_TURN = 2 * math.pi
# Samples of a fringe: an envelope changes by 0.002 from one to the next at most.
_SAMPLES = 128
# Fringes beyond the panel.
_BEYOND = 4
# Variances of the blur, radians^2: between tables, at least, and at most, which leaves a tenth
# of the fringes.
_STEP, _LEAST, _MOST = 0.03, 0.06, 4.6
# Such a variance: what the ripple of a wrong one is hardly depends on it.
_USUAL = 0.6
# Fits in windows, each of what the last one leaves, that a phase comes through.
_FITS = 3
# Of the golden section in two dimensions: evenly spread over neighbours.
_DITHER = 0.7548776662, 0.5698402910


@dataclass(frozen=True, eq=False)
class Envelope:
    """The envelope z at the bins, each with its blur.

    Attributes
    ----------
    start : float
        Phase of the first sample, radians.
    samples : int
        Of the table of one blur.
    real, imaginary : ndarray, float32
        Tables of all blurs, one after the other.
    table : ndarray, shape (rows, columns), int32
        Where each bin's table begins.
    """

    start: float
    samples: int
    real: NDArray[np.float32]
    imaginary: NDArray[np.float32]
    table: NDArray[np.int32]

    def turn(
        self,
        phase: NDArray[np.float32],
        cosine: NDArray[np.float32],
        sine: NDArray[np.float32],
    ) -> None:
        """Multiply cosine and sine of a phase, as a complex number, by the envelope, in place."""
        scale = _SAMPLES / _TURN
        place = phase * np.float32(scale)
        place -= np.float32(self.start * scale - 0.5)
        np.clip(place, 0, self.samples - 1, out=place)
        index = place.astype(np.int32)
        index += self.table
        real, imaginary = self.real.take(index), self.imaginary.take(index)
        across = imaginary * cosine
        imaginary *= sine
        cosine *= real
        cosine -= imaginary
        sine *= real
        sine += across


class ContrastModel:
    """Envelopes of a pattern whose contrast is its code.

    Parameters
    ----------
    pattern : Pattern

    Attributes
    ----------
    ripple : float
        Phase that a blur wrong by 1 radian^2 feigns, root mean square over the code, radians.
    """

    def __init__(self, pattern: Pattern) -> None:
        orders = pattern.fringe_orders
        first = orders.start - _BEYOND
        count = (len(orders) + 2 * _BEYOND) * _SAMPLES
        self._start = _TURN * (first - 0.25)
        phase = self._start + _TURN / _SAMPLES * np.arange(count)
        # Each projector pixel is even: the light's integral is straight over it.
        ends = pattern.column(phase[[0, -1]])
        pixels = np.arange(math.floor(ends[0]) - 1, math.ceil(ends[1]) + 2)
        total = np.append(0, np.cumsum(2 * pattern.intensity(pixels) - 1))
        half = _TURN / _SAMPLES / 2
        above, below = (
            np.interp(pattern.column(phase + side), np.append(pixels, pixels[-1] + 1) - 0.5, total)
            for side in (half, -half)
        )
        light = np.fft.rfft((above - below) * (_SAMPLES / pattern.period_px))
        light /= np.sinc(1 / pattern.period_px)
        frequency = np.fft.rfftfreq(count, _TURN / _SAMPLES) * _TURN
        self._samples = count
        self._tables = np.empty((2, round((_MOST - _LEAST) / _STEP) + 1, count), np.float32)
        for level, (real, imaginary) in enumerate(self._tables.transpose(1, 0, 2)):
            variance = _LEAST + level * _STEP
            blurred = light * np.exp(variance / 2 * (1 - np.square(frequency)))
            fringes, slope = (
                np.fft.irfft(each, count) for each in (blurred, 1j * frequency * blurred)
            )
            z = (fringes - 1j * slope) * np.exp(-1j * phase)
            real[:], imaginary[:] = z.real, z.imag
        self.ripple = self._ripple_of_blur()

    def envelope(self, variance: NDArray[np.float32]) -> Envelope:
        """Envelope of blurs of variances, radians^2, at the bins, shape (rows, columns)."""
        # Between two tables, neighbouring bins take the one or the other by the share of each.
        level = variance * np.float32(1 / _STEP)
        level += _shares(variance.shape)
        np.clip(level, 0, self._tables.shape[1] - 1, out=level)
        table = level.astype(np.int32)
        table *= np.int32(self._samples)
        real, imaginary = (each.ravel() for each in self._tables)
        return Envelope(self._start, self._samples, real, imaginary, table)

    def _ripple_of_blur(self) -> float:
        level = round((_USUAL - _LEAST) / _STEP)
        turn = np.exp(1j * (self._start + _TURN / _SAMPLES * np.arange(self._samples)))
        fringes, blurred = (
            (self._tables[0, place] + 1j * self._tables[1, place]) * turn
            for place in (level, level + 1)
        )
        change, sine = blurred.real - fringes.real, fringes.imag
        reach = np.arange(-2 * _SAMPLES, 2 * _SAMPLES + 1)
        window = np.exp(-0.5 * np.square(reach / (WIDTH * _SAMPLES)))
        power = np.convolve(np.square(sine), window, mode='same')
        shift = np.zeros_like(change)
        for _ in range(_FITS):
            shift += np.convolve((change - sine * shift) * sine, window, mode='same') / power
        inner = slice(_BEYOND * _SAMPLES, -_BEYOND * _SAMPLES)
        return float(np.sqrt(np.mean(np.square(shift[inner]))) / _STEP)


@lru_cache(maxsize=4)
def _shares(shape: tuple[int, int]) -> NDArray[np.float32]:
    """What is added to the place of each bin's blur between the tables before it is cut off."""
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    share = (rows * _DITHER[0] + columns * _DITHER[1]) % 1 - _LEAST / _STEP
    return share.astype(np.float32)
