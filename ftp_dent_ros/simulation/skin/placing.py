"""Where parts of a panel lie: coordinates along and across what is turned on it."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray


def turned(x: NDArray[Any], y: NDArray[Any], angle: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Coordinates along and across a direction.

    Parameters
    ----------
    x, y : ndarray
        On the panel from the part's centre, of any shape and floating-point type.
    angle : float
        From the panel's x axis to the direction, towards y, radians.

    Returns
    -------
    along, across : ndarray
        Of the same shape and type.
    """
    c, s = math.cos(angle), math.sin(angle)
    return x * c + y * s, y * c - x * s
