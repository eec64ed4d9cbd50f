"""Wiener's gain of each octave of the phase, against the noise that the fringes' contrast shows.

What dirt, speckle, grain and pixels add near the carrier shifts the fringes and changes their
contrast; the skin's shape shifts them only. So the contrast's logarithm measures the phase's noise
(eq. 8), and energy beyond it is the skin's shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri

from ftp_dent_ros.cloud.response import OF_NOISE, left_out
from ftp_dent_ros.profilometry.fringe_model.bins import WIDTH, BinGrid

# Octaves: the widest window is 16 fringes, beyond which a quadric follows the skin.
_OCTAVES = 5
# Windows that an energy is the mean of, about.
_COUNT = 7
# Widths of windows over which noise is a mean: 9 times as many count. Energy is the mean over one.
_AVERAGED = 3.0
# Energy over the noise's that shows the skin's shape, which noise has in one place of 10,000; and
# that is shape if the next octave's shape is stronger than this noise: in one place of 20.
_SHOWN, _STRAYS = (
    np.float32(fdtri(_COUNT, _COUNT * _AVERAGED**2, 1 - each)) for each in (1e-4, 0.05)
)


@dataclass(frozen=True, eq=False)
class Denoised:
    """A surface's phase at the nodes: arrays of shape (rows, nodes), float32.

    Attributes
    ----------
    phase : ndarray
        About the reference, radians.
    variance : ndarray
        Mean square error: noise that is left, and signal that is not; radians^2.
    finest : ndarray
        Gain of the finest octave.
    noise : ndarray
        Variance of the phase as it was, radians^2.
    """

    phase: NDArray[np.float32]
    variance: NDArray[np.float32]
    finest: NDArray[np.float32]
    noise: NDArray[np.float32]


def denoise(
    grid: BinGrid,
    phase: NDArray[np.float32],
    changes: Sequence[NDArray[np.float32]],
    ratios: Sequence[NDArray[np.float32]],
    weight: NDArray[np.float32],
    posterior: NDArray[np.float32],
) -> Denoised:
    """Denoise a surface's phase.

    Parameters
    ----------
    grid : BinGrid
    phase : ndarray, shape (rows, nodes)
        About a quadric, radians.
    changes : sequence of ndarray, shape (rows, nodes)
        Logarithms of the amplitude over the level, and of the amplitude, about quadrics. Paint
        changes the latter only, ambient light the former; noise changes both.
    ratios : sequence of ndarray, shape (rows, nodes)
        Variance of the phase over theirs, in noise that light has.
    weight : ndarray, shape (rows, nodes), float32
        How much nodes count: 1, less where they may be wrong, 0 beyond the surface.
    posterior : ndarray, shape (rows, nodes), float32
        Variance of the phase in one window by what the fit leaves, radians^2: noise is no less.
    """
    mean, white = _Means(grid, weight), _white_noise()
    noises = _noises(mean, changes, ratios, posterior)
    beyond = white.beyond * noises[-1] / mean.share(WIDTH * 2 ** (_OCTAVES - 1))
    details, kept = _octaves(mean, phase)
    variance, whole, coarser = (np.zeros_like(phase) for _ in range(3))
    for octave in reversed(range(_OCTAVES)):
        width, detail, noise = WIDTH * 2**octave, details.pop(), noises.pop()
        # Where little counts, as in windows that are cut at rims, noise is more.
        part = white.share[octave] * noise / mean.share(width)
        whole += part
        energy = mean.of(detail * detail, width)
        strays = energy > _STRAYS * noise
        signal = np.where(strays, energy - noise, 0)
        has_shape = (energy > _SHOWN * noise) | (strays & (coarser > noise))
        coarser = np.where(has_shape, signal, 0)
        gain = mean.of(coarser / np.maximum(energy, np.float32(1e-12)), WIDTH * width)  # eq. 9
        kept += gain * detail
        taken = np.square(1 - gain)
        lost = mean.of(taken * detail * detail, width)
        lost = np.where(lost > _STRAYS * taken * noise, lost - taken * noise, 0)
        variance += gain * gain * part + lost  # eq. 10
    # Windows miss as much of dents three fringes wide as the finest octave shows.
    return Denoised(kept, variance + coarser + beyond, gain, whole + beyond)


def _octaves(mean: _Means, low: Any) -> tuple[list[NDArray[np.float32]], NDArray[np.float32]]:
    """Details of values in the octaves, from the finest on, and what is beyond them."""
    details = []
    for octave in range(_OCTAVES):
        smooth = mean.flat_top(low, WIDTH * 2**octave)
        details.append(low - smooth)
        low = smooth
    return details, low


def _noises(mean: _Means, changes, ratios, posterior) -> list[NDArray[np.float32]]:
    """Energy of the phase's noise in the octaves, by changes of contrast and amplitude (eq. 8).

    It is measured over the posterior, which knows where the light is faint.
    """
    noises: list[NDArray[np.float32]] = []
    for octave, energy in enumerate(_white_noise().energy):
        usual = np.maximum(mean.of(posterior, WIDTH * 2**octave), np.finfo(np.float32).tiny)
        shown = (
            r * _shown(mean, octave, x, np.sqrt(usual))
            for r, x in zip(ratios, changes, strict=True)
        )
        noises.append(np.maximum(np.minimum(*shown) * usual, energy * posterior))
        if octave:
            changes = [mean.flat_top(each, WIDTH * 2 ** (octave - 1)) for each in changes]
    return noises


def _shown(
    mean: _Means, octave: int, change: NDArray[np.float32], unit: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Energy of an octave's noise over the square of a unit, in a change.

    The change is without what is finer than the octave before. Dirt is white along u from one
    octave to the next, trends of light are not: each octave but the finest follows from the one
    before along u.
    """
    width = WIDTH * 2**octave
    if not octave:
        return mean.variance((change - mean.flat_top(change, width)) / unit, _AVERAGED * width)
    before = mean.of(change, 0, width / 2)
    fine = before - mean.of(before, width / 2, 0)
    both = fine, mean.of(fine, 0, width)
    return _white_noise().of_fine(
        octave, *(mean.variance(each / unit, _AVERAGED * width) for each in both)
    )


@dataclass(frozen=True)
class _WhiteNoise:
    """Noise of the light, white along u, as the phase has it in each octave.

    Attributes
    ----------
    energy : ndarray, shape (octaves,)
        Mean square over the variance in one window, of noise that is white along v, too.
    share : ndarray, shape (octaves,)
        What the variance loses with the octave, over that: neighbouring octaves are correlated.
    beyond : float32
        Variance beyond the widest window, over the last octave's energy.
    fine : ndarray, shape (octaves, 2)
        Weights of what is in the octave before along u, and smooth along v as that octave, and as
        this one: right for noise that is white along v, and for noise that is even there. The
        finest octave needs none.
    """

    energy: NDArray[np.float32]
    share: NDArray[np.float32]
    beyond: np.float32
    fine: NDArray[np.float32]

    def of_fine(self, octave: int, before, after) -> NDArray[np.float32]:
        """Energy of an octave by that of what is fine along u (eq. 8)."""
        of_before, of_after = self.fine[octave]
        return of_before * before + of_after * np.minimum(after, before)


@cache
def _white_noise() -> _WhiteNoise:
    """What windows pass of noise, by its frequency along u and v."""
    step = 0.01
    frequency = np.arange(step / 2, 5, step)
    along_u, along_v = np.square(frequency) / 2, np.square(frequency[:, None]) / 2
    square = along_u + along_v
    left = before = 1 - left_out(square, OF_NOISE)
    # Both of noise that is white along v, and of noise that is even there.
    energy, after, weights = [], [_energies(left)], []
    for octave in range(_OCTAVES):
        detail = left * left_out(square * 4**octave, 2)
        energy.append(_energies(detail))
        fine = before * left_out(along_u * 4 ** (octave - 1), 1)
        fine = fine * np.exp(-along_v * 4 ** (octave - 1))
        of_fine = np.column_stack(
            [_energies(fine), _energies(fine * np.exp(-along_v * 4**octave))]
        )
        weights.append(np.linalg.solve(of_fine, energy[-1]))
        left, before = left - detail, left
        after.append(_energies(left))
    # A window's own, in the same unit.
    window = _energies(np.exp(-square))[0]
    of_white, lost = np.array(energy)[:, 0], -np.diff(np.array(after)[:, 0])
    return _WhiteNoise(
        (of_white / window).astype(np.float32),
        (lost / of_white).astype(np.float32),
        np.float32(after[-1][0] / of_white[-1]),
        np.array(weights, np.float32),
    )


def _energies(passed: NDArray[np.floating]) -> NDArray[np.float64]:
    """Mean square of white noise, and of noise that is even along v."""
    return np.array([np.square(passed).mean(), np.square(passed[0]).mean()])


class _Means:
    """Gaussian means of values at the nodes of a surface."""

    def __init__(self, grid: BinGrid, weight: NDArray[np.float32]) -> None:
        self._grid, self._weight = grid, weight
        self._shares: dict[Any, NDArray[np.float32]] = {}

    def share(self, *fringes):
        """Mean weight in windows of so many fringes."""
        if fringes not in self._shares:
            share = self._grid.smooth_nodes(self._weight, *fringes)
            self._shares[fringes] = np.maximum(share, np.float32(1e-6))
        return self._shares[fringes]

    def of(self, values, *fringes):
        """Mean over so many fringes."""
        return self._grid.smooth_nodes(values * self._weight, *fringes) / self.share(*fringes)

    def flat_top(self, values, *fringes):
        """The mean, and the mean of what it leaves: slopes and bends pass."""
        mean = self.of(values, *fringes)
        return mean + self.of(values - mean, *fringes)

    def variance(self, change, fringes):
        """Mean square of a Gaussian change, by its mean absolute value: edges count less."""
        return np.float32(np.pi / 2) * np.square(self.of(np.abs(change), fringes))
