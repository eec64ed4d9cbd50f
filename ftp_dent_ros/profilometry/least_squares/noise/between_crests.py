"""Doubt about fine detail, by light where the fringes are dark.

What skin does to the fringes' light (its albedo, its gloss) grows with that light: between crests
there is none, but for light from elsewhere. Where the photograph misfits between crests too, its
fringes are not of one smooth surface: a cord before it, an edge of it or of a shadow, a dead
column. What passes for detail of the surface there may be these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Energy over what else explains it, from which on it is a sign: a window's mean scatters by less.
_SURELY = 2.0
# Means of a cosine and of its square, weighted by the square of its negative half.
_COSINE, _SQUARE = -8 / (3 * np.pi), 0.75
_LEAST = np.float32(1e-9)
# Nodes along u and v that are looked at, and the part of them that has less than everywhere.
_EVERY, _FEW = 3, 0.1


def doubt_in_dark(
    in_dark: NDArray[np.float32],
    misfit: NDArray[np.float32],
    pixels: NDArray[np.float32],
    contrast: NDArray[np.float32],
    inside: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """Share of the misfit between crests that neither noise nor albedo explains, 0 to 1.

    Parameters
    ----------
    in_dark, misfit : ndarray, shape (rows, columns), float32
        Mean squares of what the fringes leave of the bins, in amplitudes: between the crests,
        weighted by the square of the negative half of the cosine, and of all.
    pixels : ndarray, shape (rows, columns), float32
        Variance of the bins by the pixels' noise.
    contrast : ndarray, shape (rows, columns), float32
        Amplitude over level.
    inside : ndarray, shape (rows, columns), bool
        Nodes of the surface.
    """
    level = 1 / np.clip(contrast, _LEAST, 1)
    square = np.square(level)
    # An albedo leaves of each bin what its light, level and fringe, is.
    of_albedo = (square + np.float32(2 * _COSINE) * level + np.float32(_SQUARE)) / (square + 0.5)
    sample = in_dark[::_EVERY, ::_EVERY][inside[::_EVERY, ::_EVERY]]
    # What is so everywhere is a camera's curve, or its noise in the dark.
    rank = int(_FEW * len(sample))
    everywhere = np.partition(sample, rank)[rank] if len(sample) else np.float32(0)
    explained = np.float32(_SURELY) * (of_albedo * misfit + np.maximum(pixels, everywhere))
    return np.maximum(1 - explained / np.maximum(in_dark, _LEAST), 0)
