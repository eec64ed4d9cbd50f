"""The camera's curve, as coded fringes show it.

Levels that go with a power of the light have a second harmonic, and levels that change with the
contrast from fringe to fringe: a ripple with the code. That power of the levels which leaves no
second harmonic takes both off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.code_blur import sampled_rows, told_of

# Second harmonic over the first from which on a camera is not linear: a power of 1.1.
_CURVED = 0.01
# Steps of the search, and the powers that cameras have.
_STEPS, _LEAST, _MOST = 6, 0.4, 3.0
# Second harmonic that is none; first step of the power.
_SETTLED, _FIRST = 5e-4, 0.5
# Of the rows that the blur is measured in, every other one: one number is told by all of them.
_EVERY = 2
# Grey levels of white.
_WHITE = 255.0


def light_power(
    pattern: Pattern,
    grid: Grid,
    windows: Windows,
    light: IntensityBins,
    phase: NDArray[np.float32],
    measured: NDArray[np.bool_],
) -> float:
    """Power of a camera's levels that grows with the light; 1 for one that is linear.

    Parameters
    ----------
    pattern : Pattern
    grid : Grid
    windows : Windows
        Those in which the fringes are fitted.
    light : IntensityBins
    phase : ndarray, shape (rows, columns), float32
        Absolute, at the nodes, radians.
    measured : ndarray, shape (rows, bins), bool
        Bins of the surface.
    """
    rows = sampled_rows(len(phase))[::_EVERY]
    at_bins = grid.at_bins(phase[rows])
    contrast = pattern.contrast(at_bins)
    fringes, shift = contrast * np.cos(at_bins), contrast * np.sin(at_bins)
    mask = measured[rows] & ~light.clipped[rows]
    share = np.maximum(light.grey[rows], 1) * np.float32(1 / _WHITE)

    def harmonic(power: float) -> float:
        levels = np.float32(_WHITE) * np.power(share, np.float32(power))
        second = 2 * np.square(fringes) - 1
        told, weight = told_of(grid, windows, levels, mask, fringes, shift, second)
        return float((weight * told).sum() / max(float(weight.sum()), 1e-9))

    before, power = 1.0, 1.0 + _FIRST
    bent = harmonic(before)
    if abs(bent) < _CURVED:
        return 1.0
    for _ in range(_STEPS):
        now = harmonic(power)
        if abs(now) < _SETTLED or now == bent:
            break
        step = now * (power - before) / (now - bent)
        before, bent = power, now
        power = float(np.clip(power - step, _LEAST, _MOST))
    return power
