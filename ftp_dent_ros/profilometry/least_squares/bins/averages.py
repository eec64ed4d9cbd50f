"""Weights of averages that are taken several times, one over the other."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Averages that one product of matrices makes.
_BLOCK = 8


@lru_cache(maxsize=16)
def boxes(size: int, order: int) -> NDArray[np.floating]:
    """Weights of averages over `size`, taken `order` times."""
    taps = np.ones(1)
    for _ in range(order):
        taps = np.convolve(taps, np.full(size, 1 / size))
    return taps


@lru_cache(maxsize=16)
def weights_in_blocks(
    size: int, count: int, order: int
) -> tuple[tuple[slice, slice, NDArray[np.float32]], ...]:
    """Averages over every `size` of `count` values, as products of matrices.

    For blocks of averages: which they are, the values that they need, and the weights of those,
    shape (values, averages). Values beyond the ends are left out.
    """
    taps = boxes(size, order)
    before = len(taps) // 2 - size // 2
    blocks = []
    for first in range(0, count // size, _BLOCK):
        some = min(_BLOCK, count // size - first)
        weights = np.zeros((count + 2 * len(taps), some), np.float32)
        for each in range(some):
            start = (first + each) * size - before + len(taps)
            weights[start : start + len(taps), each] = taps
        weights = weights[len(taps) : -len(taps)]
        used = np.flatnonzero(weights.any(axis=1))
        needed = slice(int(used[0]), int(used[-1]) + 1)
        made = slice(first, first + some)
        blocks.append((made, needed, np.ascontiguousarray(weights[needed])))
    return tuple(blocks)
