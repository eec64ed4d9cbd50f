"""Other light among the fringes: what it does to their contrast, it does to their phase.

Light that varies about as fast as the fringes do (their mirror image in a glossy corner, another
projector, a row of dark screws, an edge of paint), of amplitude r over theirs and at a phase delta
to them, turns their phase by ``r sin delta`` and changes their amplitude by ``r cos delta``. As
delta runs through all values, both have the same energy. What the surface's phase should be is not
known, but its contrast, the amplitude over the mean level, is smooth: the energy of what is not
smooth in it is a variance of the phase, less what has other causes. Light from elsewhere (a sun's
edge, lamps that flicker) changes the level alone, so that no more counts than the amplitude itself
changes; where it is even, the contrast c changes where the amplitude B does, by
``d ln c = (1 - c) d ln B`` at most; and there is the pixels' noise.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import (
    Windows,
    coarsened,
    interpolated,
    sighted,
)
from ftp_dent_ros.profilometry.least_squares.noise.bands import SCALES
from ftp_dent_ros.profilometry.least_squares.noise.denoising import NOISE
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import NoiseGain

# The phase's bands that are looked at: what is longer than some ten fringes is smooth.
_BANDS = 3
# Windows over which energy is a mean: the neighbourhood that the coarsest of these bands has.
_NEIGHBOURHOOD = 4.0
# Nodes along u and v that are taken together, and of these, every so many tell the trend.
_TOGETHER, _EVERY = 2, 3
_TERMS = 6
# A contrast or a grey level that has a logarithm; share of a neighbourhood that must be known.
_LEAST, _LEAST_SHARE = np.float32(1e-3), np.float32(0.1)


class OtherLight:
    """Tells the variance of the phase by the contrast.

    Parameters
    ----------
    windows : Windows
    noise : NoiseGain
        Of the phase, whose fits are those of level and amplitude, or more.
    """

    def __init__(self, windows: Windows, noise: NoiseGain) -> None:
        self._windows = windows
        self._coarse = Windows(windows.sigma_u / _TOGETHER, windows.sigma_v / _TOGETHER)
        # Of the amplitude; half of it of the level, over the amplitude.
        self._noise = np.float32(NOISE * sum(noise.shares[:_BANDS]))

    def variance(
        self,
        level: NDArray[np.float32],
        modulation: NDArray[np.float32],
        pixels: NDArray[np.float32],
        inside: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """Variance of the phase by other light, radians^2.

        Parameters
        ----------
        level, modulation : ndarray, shape (rows, columns), float32
            Mean and amplitude of the fringes at the nodes, grey levels.
        pixels : ndarray, shape (rows, columns), float32
            Variance of the bins, in amplitudes, by the pixels' noise.
        inside : ndarray, shape (rows, columns), bool
            Nodes of the surface.
        """
        shape, together = level.shape, (_TOGETHER, _TOGETHER)
        inside = coarsened(sighted(inside, self._windows).astype(np.float32), together) == 1
        if np.count_nonzero(inside[::_EVERY, ::_EVERY]) < _TERMS:
            return np.zeros(shape, np.float32)
        level, modulation, pixels = (
            coarsened(each, together) for each in (level, modulation, pixels)
        )
        contrast = np.clip(modulation / at_least(level, 1), _LEAST, 1)
        beyond = Extrapolation(inside, self._coarse)
        logarithms = np.log(at_least(np.stack([contrast, modulation]), _LEAST))
        changed, brighter = self._uneven(logarithms, inside, beyond)
        energy = np.minimum(np.square(changed), np.square(brighter))
        energy -= np.square((1 - contrast) * brighter)
        energy -= self._noise * pixels * (1 + np.square(contrast) / 2)
        mean, share = (
            self._coarse.wide(each.astype(np.float32), _NEIGHBOURHOOD)
            for each in (energy * inside, inside)
        )
        return interpolated(at_least(mean, 0) / at_least(share, _LEAST_SHARE), shape)

    def _uneven(self, fields, inside, beyond: Extrapolation) -> list[NDArray[np.float32]]:
        """Fields less their trends over the surface, and less what of them is smooth."""
        terms, chosen = _terms(inside.shape), inside[::_EVERY, ::_EVERY]
        known = terms[:, ::_EVERY, ::_EVERY][:, chosen].T
        trends, *_ = np.linalg.lstsq(known, fields[:, ::_EVERY, ::_EVERY][:, chosen].T, rcond=None)
        rests = map(beyond.by_mean, fields - np.tensordot(trends.astype(np.float32).T, terms, 1))
        return [rest - self._coarse.wide_flat_top(rest, SCALES[_BANDS - 1]) for rest in rests]


@lru_cache(maxsize=4)
def _terms(shape: tuple[int, int]) -> NDArray[np.float32]:
    """Of a quadric trend over a field, shape (terms, rows, columns)."""
    y, x = np.ogrid[tuple(slice(-1, 1, 1j * length) for length in shape)]
    return np.stack(np.broadcast_arrays(1.0, x, y, x * x, x * y, y * y)).astype(np.float32)
