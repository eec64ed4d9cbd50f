"""What a cloud shows of waves on the skin, and of the light's noise: Gaussian windows' response.

A surface comes from fits in Gaussian windows, each of which corrects the ones before. Of a wave
they leave out (1 - G)^fits, G being what one window passes.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

#: So many pass as much as the rounds of the solver do: of noise; and of waves on the skin, which
#: level and contrast of the light follow in part, so that bottoms of narrow dents of four shapes
#: come out within 2 % by it.
OF_NOISE, OF_WAVES = 5, 2


def left_out(square: NDArray[np.floating], fits: int) -> NDArray[np.floating]:
    """Of waves, what some fits leave out.

    Parameters
    ----------
    square : ndarray
        Half the square of angular frequencies times the windows' standard deviation.
    fits : int
    """
    return (1 - np.exp(-square)) ** fits


def halved(fits: int) -> float:
    """Wavelength of which half is left out, in the windows' standard deviations."""
    return math.pi * math.sqrt(2 / -math.log(1 - 0.5 ** (1 / fits)))


@lru_cache(maxsize=256)
def white_noise(smoothing: float = 0.0, fits: int = OF_NOISE) -> tuple[float, float]:
    """What some fits and a Gaussian mean leave of white noise.

    Parameters
    ----------
    smoothing : float
        Standard deviation of the Gaussian, in the windows'.
    fits : int

    Returns
    -------
    variance : float
        Over that after one window.
    frequency : float
        Mean square of its angular frequency along one direction, times the windows' variance.
    """
    # Even over the plane's rings.
    values = np.linspace(0.0, 12.0, 6001)[1:]
    left = np.square((1 - left_out(values, fits)) * np.exp(-values * smoothing**2))
    total = left.sum()
    return float(2 * values[0] * total), float((values * left).sum() / total)
