"""Bands that a field at the nodes is split into."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows

# Standard deviations of the bands' edges, in those of the windows. The bands are differences of
# flat-tops, which leave nothing of a smooth dent in the finer ones.
SCALES = (1.4, 2.8, 5.6, 11.2)
# The finer bands, in which a contrast is the skin's: what is longer is the lens's and the light's.
OF_SKIN = SCALES[:3]
# Standard deviation of the mean along the fringes that leaves a seventeenth of white noise in the
# finest band, and all of what goes along them; in those of the windows.
ALONG = 5.6


def split(
    values: NDArray[np.float32], windows: Windows, scales: tuple[float, ...] = SCALES
) -> tuple[list[NDArray[np.float32]], NDArray[np.float32]]:
    """Bands from fine to coarse, and what is below them."""
    levels = [values, *(windows.wide_flat_top(values, scale) for scale in scales)]
    return [finer - coarser for finer, coarser in pairwise(levels)], levels[-1]
