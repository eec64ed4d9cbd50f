"""Light over the skin's brightness: what is left of an albedo does not pass for fringes.

An albedo multiplies the fringes. Where it grows within a window, a fit of level and amplitude
takes the growth of the fringes for a phase, the more where their contrast changes as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.robust import median

# Of the surface's own: what is darker is taken to be no darker, and its noise not for light.
_DARKEST = 0.02
_EVERY = 2  # nodes along u and v that are looked at


def brightness(level: NDArray[np.float32], region: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Level of the fringes at the nodes over that of most of a region, above zero.

    Parameters
    ----------
    level : ndarray, shape (rows, columns), float32
        Grey levels.
    region : ndarray, shape (rows, columns), bool
        Where it is told: carried on from there it goes to zero.
    """
    sample = level[::_EVERY, ::_EVERY][region[::_EVERY, ::_EVERY]]
    usual = max(median(sample), 1.0) if len(sample) else 1.0
    return at_least(level * np.float32(1 / usual), _DARKEST)


def evened(
    levels: NDArray[np.float32], bright: NDArray[np.float32], grid: Grid
) -> NDArray[np.float32]:
    """Bins over the brightness at the nodes around them.

    Parameters
    ----------
    levels : ndarray, shape (rows, bins), float32
        Light of the bins, grey levels.
    bright : ndarray, shape (rows, columns), float32
        As `brightness` tells it of the nodes.
    grid : Grid
    """
    return levels / at_least(grid.at_bins(bright), _DARKEST)
