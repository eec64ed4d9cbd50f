"""The contrast of each whole fringe in each row: its amplitude over its level."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TURN = 2 * math.pi
# Share of a fringe that must be seen for a contrast, and of a cosine's variation that is left.
_WHOLE, _VARIATION = 0.8, 0.15
# Share of the variation that a slope of the light leaves to the cosine: two fifths of a whole one.
_TOLD = 0.2


@dataclass(frozen=True, eq=False)
class FringeContrasts:
    """Contrasts of whole fringes.

    Attributes
    ----------
    row, order : ndarray, shape (n,), int
        Row of bins, and whole turns of the phase.
    logarithm, variance : ndarray, shape (n,)
        Natural logarithm of the contrast, and its variance by what the fringe leaves.
    amplitude : ndarray, shape (n,)
        Natural logarithm of the amplitude in light that may grow evenly over each fringe.
    """

    row: NDArray[np.intp]
    order: NDArray[np.int32]
    logarithm: NDArray[np.float32]
    variance: NDArray[np.float32]
    amplitude: NDArray[np.float32]


def fringe_contrasts(
    grey: NDArray[np.float32],
    phase: NDArray[np.float32],
    inside: NDArray[np.bool_],
    seen: NDArray[np.bool_],
) -> FringeContrasts:
    """Contrasts of the fringes that are seen whole.

    Parameters
    ----------
    grey : ndarray, shape (rows, columns), float32
        Light of the bins, grey levels.
    phase : ndarray, shape (rows, columns), float32
        Of the bins, right but for whole turns, radians.
    inside : ndarray, shape (rows, columns), bool
        Bins of the region: a fringe ends where it does.
    seen : ndarray, shape (rows, columns), bool
        Those of them whose light can be used.
    """
    turns = np.floor(phase * np.float32(1 / _TURN) + np.float32(0.25)).astype(np.int32)
    begins = np.ones(phase.shape, bool)
    begins[:, 1:] = (turns[:, 1:] != turns[:, :-1]) | (inside[:, 1:] != inside[:, :-1])
    start = np.flatnonzero(begins)
    last = np.append(start[1:], phase.size) - 1
    in_region = inside.ravel()[start]
    weight = seen.astype(np.float32)
    cosine = np.cos(phase) * weight
    level = grey * weight
    place = (phase - np.float32(_TURN) * turns) * weight

    def total(values):
        return np.add.reduceat(values.ravel(), start)[in_region]

    n, c, cc = total(weight), total(cosine), total(cosine * cosine)
    i, ic, ii = total(level), total(level * cosine), total(level * level)
    x, xx, xc, xi = (total(place * each) for each in (weight, place, cosine, level))
    start, last = start[in_region], last[in_region]
    bins = last - start + 1
    ends = phase.ravel()
    span = np.abs(ends[last] - ends[start]) * bins / np.maximum(bins - 1, 1)
    n = np.maximum(n, 1)
    variation = cc - c * c / n
    amplitude = (ic - i * c / n) / np.maximum(variation, 1e-3)
    mean = (i - amplitude * c) / n
    good = (span > _WHOLE * _TURN) & (n > _WHOLE * bins) & (variation > _VARIATION * n)
    good &= (amplitude > 1) & (mean > 1)
    rest = ii - i * i / n - amplitude * amplitude * variation
    variance = np.maximum(rest, 0) / np.maximum(n - 2, 1) / np.maximum(variation, 1e-3)
    # A fringe is bright on one side, and dark on the other: light that grows is told from it.
    square, both = xx - x * x / n, xc - x * c / n
    told = square * variation - both * both
    alone = ((ic - i * c / n) * square - (xi - x * i / n) * both) / np.maximum(told, 1e-3)
    alone = np.where(told > _TOLD * square * variation, alone, amplitude)
    start, amplitude = start[good], amplitude[good]
    return FringeContrasts(
        start // phase.shape[1],
        turns.ravel()[start],
        np.log(amplitude / mean[good]),
        variance[good] / np.square(amplitude),
        np.log(np.maximum(alone[good], 1)),
    )
