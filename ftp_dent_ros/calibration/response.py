"""How late the projector shows what it is told, and how its light follows the grey level."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

# Photographs after a change, and levels of the ramp.
_LOOKS, _LEVELS = 8, 9
_TOP = 254
# Of the brightest pixels, those that the projector lights surely.
_LIT = 90
_CLIPPED = 250

Show = Callable[[NDArray[np.uint8]], int]
Photograph = Callable[[int], tuple[NDArray[np.uint8], int]]


def projector_delay(show: Show, photograph: Photograph, size: tuple[int, int]) -> float:
    """Time from the message to the light, seconds: until photographs no longer change.

    The projector goes from black to white; the delay ends at the first photograph that is as
    bright as the last, so that it holds the projector's own frame and the camera's error of
    stamps, and is right to the time between two photographs.
    """
    black, white = (_even(level, size) for level in (0, _TOP))
    photograph(show(black))
    shown_ns = show(white)
    levels, times = [], []
    for _ in range(_LOOKS):
        image, stamp_ns = photograph(0)
        levels.append(float(image.mean()))
        times.append((stamp_ns - shown_ns) / 1e9)
    late = [i for i, level in enumerate(levels) if level < 0.95 * levels[-1]]
    return max(0.0, times[late[-1] + 1]) if late and late[-1] + 1 < len(times) else 0.0


def response(
    show: Show, photograph: Photograph, size: tuple[int, int], delay_ns: int
) -> tuple[list[float], float]:
    """Light of a ramp of grey levels, 0 to 1, and the exponent that follows it best.

    Returns
    -------
    light : list of float
        At evenly spaced grey levels, the camera's, less black.
    gamma : float
        NaN where the white is clipped or nothing is lit.
    """
    grey = np.linspace(0, _TOP, _LEVELS)
    images = [
        photograph(show(_even(round(float(level)), size)) + delay_ns)[0].astype(float)
        for level in grey
    ]
    lit = images[-1] >= np.percentile(images[-1], _LIT)
    levels = np.array([float(np.median(image[lit])) for image in images])
    span = levels[-1] - levels[0]
    if span < 10 or levels[-1] >= _CLIPPED:
        return [round(float(level), 1) for level in levels], float('nan')
    light = (levels - levels[0]) / span
    inner = (light > 0.02) & (grey > 0) & (grey < _TOP)
    if inner.sum() < 3:
        return [round(float(x), 4) for x in light], float('nan')
    x, y = np.log(grey[inner] / _TOP), np.log(light[inner])
    return [round(float(value), 4) for value in light], float(x @ y / (x @ x))


def _even(level: int, size: tuple[int, int]) -> NDArray[np.uint8]:
    return np.full((size[1], size[0], 3), level, np.uint8)
