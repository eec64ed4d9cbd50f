"""How late the projector shows what it is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Show = Callable[[NDArray[np.uint8]], int]
Photograph = Callable[[int], tuple[NDArray[np.uint8], int]]


def projector_delay(show: Show, photograph: Photograph, size: tuple[int, int]) -> float:
    """Time from the message to the light, seconds: until photographs no longer change.

    The projector goes from black to white; the delay ends at the first photograph that is as
    bright as the last, so that it holds the projector's own frame and the camera's error of
    stamps, and is right to the time between two photographs.
    """
    black, white = (_even(level, size) for level in (0, 254))
    photograph(show(black))
    shown_ns = show(white)
    levels, times = [], []
    for _ in range(8):
        image, stamp_ns = photograph(0)
        levels.append(float(image.mean()))
        times.append((stamp_ns - shown_ns) / 1e9)
    late = [i for i, level in enumerate(levels) if level < 0.95 * levels[-1]]
    return max(0.0, times[late[-1] + 1]) if late and late[-1] + 1 < len(times) else 0.0


def _even(level: int, size: tuple[int, int]) -> NDArray[np.uint8]:
    return np.full((size[1], size[0], 3), level, np.uint8)
