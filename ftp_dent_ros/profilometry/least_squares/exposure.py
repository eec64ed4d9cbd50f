"""Whether a photograph has light enough, and not too much."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import SaturatedError, TooDarkError
from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.light import Light

_SMALLEST_SHARE = 0.002
_LARGEST_CLIPPED_SHARE = 0.5


def check_exposure(light: Light, lit: NDArray[np.bool_], grid: Grid, period: float) -> None:
    """Raise the reason if there are too few fringes, or most of them are clipped.

    Parameters
    ----------
    light : Light
    lit : ndarray, shape (rows, columns), bool
        Nodes with fringes.
    grid : Grid
    period : float
        Of the fringes, pixels.

    Raises
    ------
    TooDarkError, SaturatedError
    """
    clipped = light.clipped
    if np.count_nonzero(clipped) > _SMALLEST_SHARE / 2 * clipped.size:
        size = 2 * math.ceil(period / grid.step / 2) + 1
        lost = cv2.blur(clipped.astype(np.float32), (size, 1)) > _LARGEST_CLIPPED_SHARE
        share = lost.sum() / max((lost | grid.to_bins(lit)).sum(), 1)
        if lost.mean() > _SMALLEST_SHARE and share > _LARGEST_CLIPPED_SHARE:
            raise SaturatedError(
                f'the fringes are clipped over {share:.0%} of the lit area: '
                'expose for a shorter time'
            )
    if np.count_nonzero(lit) < _SMALLEST_SHARE * lit.size:
        raise TooDarkError(
            'no part of the image shows fringes: switch the projector on, come closer, or '
            'expose longer'
        )
