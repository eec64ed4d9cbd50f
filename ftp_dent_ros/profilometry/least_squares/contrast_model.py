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

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern import Pattern

_TURN = 2 * math.pi
# Samples of a fringe: an envelope changes by 0.002 from one to the next at most.
_SAMPLES = 128
# Fringes beyond the panel.
_BEYOND = 4
# Variances of the blur, radians^2: between tables, at least and at most.
_STEP, _LEAST, _MOST = 0.03, 0.06, 1.8
# Of the golden section in two dimensions: evenly spread over neighbours.
_DITHER = 0.7548776662, 0.5698402910
# Between those over which the change of the envelope is taken, and rows that it is measured in.
_CHANGE, _ROWS = 0.2, 40
# Fringes that are fitted together, and bins of theirs with which a fit of four unknowns is none.
_TOGETHER, _FEWEST = 3, 12
# Standard deviation of what blurs of lenses differ by from the one expected, radians^2.
_SPREAD = 0.2


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
        rows: slice,
    ) -> None:
        """Multiply cosine and sine of a phase, as a complex number, by the envelope, in place.

        `rows` are those of the bins.
        """
        scale = _SAMPLES / _TURN
        place = phase * np.float32(scale)
        place -= np.float32(self.start * scale - 0.5)
        np.clip(place, 0, self.samples - 1, out=place)
        index = place.astype(np.int32)
        index += self.table[rows]
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

    def envelope(self, variance: NDArray[np.floating]) -> Envelope:
        """Envelope of blurs of variances, radians^2, at the bins, shape (rows, columns)."""
        # Between two tables, neighbouring bins take the one or the other by the share of each.
        rows, columns = np.ogrid[: variance.shape[0], : variance.shape[1]]
        share = (rows * _DITHER[0] + columns * _DITHER[1]) % 1
        level = np.clip((variance - _LEAST) / _STEP + share, 0, self._tables.shape[1] - 1)
        table = level.astype(np.int32) * np.int32(self._samples)
        real, imaginary = (each.ravel() for each in self._tables)
        return Envelope(self._start, self._samples, real, imaginary, table)

    def blur(
        self,
        levels: NDArray[np.float32],
        phase: NDArray[np.float32],
        mask: NDArray[np.bool_],
        variance: NDArray[np.floating],
    ) -> float:
        """Variance, radians^2, by which the blur that is seen is more than the one expected.

        Over a few fringes each, light is fitted by a level, the fringes, their shift, and what
        more blur would change.

        Parameters
        ----------
        levels, phase : ndarray, shape (rows, columns), float32
            Grey levels, and absolute phase, radians.
        mask : ndarray, shape (rows, columns), bool
            Bins of the surface.
        variance : ndarray, shape (rows, columns)
            Expected, radians^2.
        """
        rows = slice(None, None, max(1, len(phase) // _ROWS))
        phase, mask, levels, variance = phase[rows], mask[rows], levels[rows], variance[rows]
        basis = []
        for side in (-_CHANGE / 2, _CHANGE / 2):
            cosine, sine = np.cos(phase), np.sin(phase)
            self.envelope(variance + side).turn(phase, cosine, sine, slice(None))
            basis.append((cosine, sine))
        (fringes, shift), (wider, _) = basis
        change = wider - fringes
        places = [
            _told(levels, phase, mask, fringes, shift, change, first) for first in range(_TOGETHER)
        ]
        told, power = np.concatenate(places, axis=1)
        if not power.sum() > 0:
            return 0.0
        order = np.argsort(told)
        told, power = told[order], power[order]
        share = np.cumsum(power) / power.sum()
        low, middle, high = (told[np.searchsorted(share, each)] for each in (0.25, 0.5, 0.75))
        # Paint and edges lean words of the code: what they scatter by is what is not known.
        error = _CHANGE * (high - low) / math.sqrt(len(told) / _TOGETHER)
        return float(_CHANGE * (middle - 0.5) * _SPREAD**2 / (_SPREAD**2 + error**2))


def _told(levels, phase, mask, fringes, shift, change, first) -> NDArray[np.float64]:
    """Change of the blur that each few fringes tell of, and how well, by their place in the code.

    They begin with the fringe `first` or a multiple of their number after it.
    """
    along_u = phase / np.float32(_TOGETHER * _TURN) - np.float32(first / _TOGETHER)
    turns = np.floor(along_u).astype(np.int32)
    along_u -= turns + np.float32(0.5)
    begins = np.ones(phase.shape, bool)
    begins[:, 1:] = (turns[:, 1:] != turns[:, :-1]) | (mask[:, 1:] != mask[:, :-1])
    start = np.flatnonzero(begins)
    bins = np.diff(start, append=phase.size)
    used = mask.ravel()[start] & (bins >= _FEWEST)
    if not used.any():
        return np.zeros((2, 0))
    # All three may change along the fringes, or the same words of the code would lean.
    plain = [np.ones_like(levels), fringes, shift]
    terms = [*plain, *(each * along_u for each in plain), change, levels]
    count, others = len(terms), len(terms) - 2
    moments = np.empty((count, count, int(used.sum())))
    for i, one in enumerate(terms):
        for j in range(i, count):
            sums = np.add.reduceat((one * terms[j]).ravel(), start)[used]
            moments[i, j] = moments[j, i] = sums
    moments = moments.transpose(2, 0, 1)
    right = moments[:, :others, others:]
    # What the others make of the change, and of the light.
    made = np.linalg.solve(moments[:, :others, :others] + 1e-6 * np.eye(others), right)
    left = moments[:, others:, others:] - right.transpose(0, 2, 1) @ made
    size = np.maximum(made[:, 1, 1], 1.0)
    place = turns.ravel()[start][used]
    place -= place.min()
    power = np.bincount(place, left[:, 0, 0])
    along = np.bincount(place, left[:, 0, 1] / size)
    known = power > 1e-3 * power.max()
    return np.stack([along[known] / power[known], power[known]])
