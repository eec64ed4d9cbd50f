"""What JPEG has done to a photograph's noise, as its pixels show it.

JPEG rounds the cosine transform of each 8x8 block to steps that differ by frequency. Fine noise
along the fringes, by which pixels tell their noise, falls below half a step and is lost; at the
fringes' own frequency it stays, and the rounding comes to it: a twelfth of the step's square.
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

# Pixels of a block, and every how many blocks along u and v are looked at.
_BLOCK, _EVERY = 8, 4
# Largest step, and largest coefficient: of a whole block of the strongest fringes.
_LARGEST_STEP, _LARGEST = 160, 1024
# Bins of a histogram of coefficients, a level: rounded pixels scatter them by 0.3.
_PER_LEVEL = 2
# Mean cosine of coefficients beyond half a step that are multiples of one: of none it is 0, but
# for chance, by so many standard deviations.
_COMB, _SURELY = 0.4, 6.0
# Steps up to which fringes' coefficients beyond this quantile reach at least: fewer teeth are no
# comb.
_TEETH, _STRONG = 2.5, 0.9
# First frequency along v that fringes hardly have, and how many along v, and along u from 1 on: by
# how often noise exceeds half a step there. Aslant fringes and dirt add to it: which of it counts.
_QUIET, _MANY, _LOW = 2, 3, 0.25
# Share of coefficients beyond half a step from which on they do not tell how noisy they are.
_MOST_BEYOND = 0.9


def jpeg_variance(plane: NDArray[np.uint8]) -> float:
    """Variance of white noise that errs as much at the fringes' frequency, levels^2; 0 if no JPEG.

    Parameters
    ----------
    plane : ndarray, shape (height, width), uint8
        Luma, its blocks as JPEG has them.
    """
    blocks = _blocks(plane)
    if not len(blocks):
        return 0.0
    transform = _cosines()
    along_u = np.abs(blocks.sum(axis=1) @ (transform[0, 0] * transform[1:]).T)
    strong = int(_STRONG * len(along_u))
    reach = np.partition(along_u, strong, axis=0)[strong]
    steps = _steps(along_u, np.minimum(reach / _TEETH, _LARGEST_STEP))
    if not steps.any():
        return 0.0
    energy = np.square(along_u).sum(axis=0)
    strongest = np.argsort(energy)[-2:]
    rounded = float(
        np.average(np.square(np.maximum(steps, 1))[strongest], weights=energy[strongest])
    )
    spectrum = np.abs(transform @ blocks @ transform.T)
    quiet = [
        _deviation(spectrum[:, row, column])
        for row in range(_QUIET, _QUIET + _MANY)
        for column in range(1, 1 + _MANY)
    ]
    known = np.array([each for each in quiet if each])
    noise = float(np.quantile(known, _LOW)) if len(known) else 0.0
    return rounded / 12 + noise * noise


def _blocks(plane: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Some blocks, shape (n, 8, 8)."""
    height, width = (size // _BLOCK for size in plane.shape)
    whole = plane[: height * _BLOCK, : width * _BLOCK]
    tiles = whole.reshape(height, _BLOCK, width, _BLOCK)[::_EVERY, :, ::_EVERY]
    return tiles.swapaxes(1, 2).reshape(-1, _BLOCK, _BLOCK).astype(np.float32)


def _steps(coefficients: NDArray[np.float32], most: NDArray[np.floating]) -> NDArray[np.intp]:
    """Largest steps, up to `most`, whose multiples coefficients are; 0 if of none.

    Parameters
    ----------
    coefficients : ndarray, shape (n, frequencies)
    most : ndarray, shape (frequencies,)
    """
    size = _PER_LEVEL * _LARGEST + 1
    place = np.minimum(coefficients * _PER_LEVEL + 0.5, size - 1).astype(np.intp)
    place += size * np.arange(len(most))
    counts = np.bincount(place.ravel(), minlength=size * len(most)).reshape(-1, size)
    # Beyond half of each step, from 2 on.
    beyond = len(coefficients) - np.cumsum(counts, axis=1)[:, _PER_LEVEL:][:, : _LARGEST_STEP - 1]
    least = np.maximum(_COMB * beyond, _SURELY * np.sqrt(beyond / 2))
    step = np.arange(2, _LARGEST_STEP + 1)
    used = int(np.flatnonzero(counts.any(axis=0))[-1]) + 1
    sums = counts[:, :used].astype(np.float32) @ _combs()[:used]
    found = (sums > least) & (step <= most[:, None])
    return np.where(found, step, 0).max(axis=1)


def _deviation(coefficients: NDArray[np.float32]) -> float:
    """Standard deviation of noise by how often it is rounded to no zero; 0 if that is not seen."""
    (step,) = _steps(coefficients[:, None], np.array([_LARGEST_STEP]))
    if not step:
        return 0.0
    share = float(np.count_nonzero(coefficients > step / 2)) / len(coefficients)
    return step / 2 / NormalDist().inv_cdf(1 - min(share, _MOST_BEYOND) / 2)


@lru_cache(maxsize=1)
def _cosines() -> NDArray[np.float32]:
    """Rows of the orthonormal cosine transform of a block."""
    place = np.arange(_BLOCK)
    rows = np.cos(math.pi / _BLOCK * (place + 0.5) * place[:, None]) * math.sqrt(2 / _BLOCK)
    rows[0] *= math.sqrt(0.5)
    return rows.astype(np.float32)


@lru_cache(maxsize=1)
def _combs() -> NDArray[np.float32]:
    """Cosine of a histogram's bins, over each step from 2 on; 0 up to half a step."""
    value = np.arange(_PER_LEVEL * _LARGEST + 1)[:, None] / _PER_LEVEL
    step = np.arange(2, _LARGEST_STEP + 1)
    return np.where(value > step / 2, np.cos(2 * math.pi * value / step), 0).astype(np.float32)
