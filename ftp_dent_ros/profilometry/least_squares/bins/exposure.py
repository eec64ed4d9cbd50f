"""Whether a photograph has light enough, not too much, and whether it is of fringes."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoFringesError, SaturatedError, TooDarkError
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.robust import median

# Of the image, that fringes or clipping take at least; and of the lit area, that may be clipped.
_SMALLEST_SHARE = 0.002
_LARGEST_CLIPPED_SHARE = 0.5
# Share of a fringe: what is left of it then, less than its trough and flanks, gives no phase.
_LOST = 0.62
# Root mean square misfit, in amplitudes, of most of a surface. Fringes of amplitude B have the
# variance B^2 / 2: at half an amplitude they still explain two thirds of what is seen, while
# fits to noise leave twice the amplitude that they find.
_LARGEST_MISFIT = 0.5


def check_exposure(
    light: IntensityBins, lit: NDArray[np.bool_], grid: Grid, period: float
) -> None:
    """Raise the reason if there are too few fringes, or most of them are clipped.

    Parameters
    ----------
    light : IntensityBins
    lit : ndarray, shape (rows, columns), bool
        Nodes with fringes.
    grid : Grid
    period : float
        Of the fringes, pixels.

    Raises
    ------
    TooDarkError, SaturatedError
    """
    if np.count_nonzero(light.clipped) > _SMALLEST_SHARE / 2 * light.clipped.size:
        size = 2 * math.ceil(period / grid.step / 2) + 1
        lost = cv2.blur(light.clipping, (size, 1)) > _LOST
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


def check_fringes(misfit: NDArray[np.float32]) -> None:
    """Raise `NoFringesError` if a surface is no surface.

    Parameters
    ----------
    misfit : ndarray, shape (nodes,)
        Root mean square of what the fringes leave around each node, in amplitudes.
    """
    if not len(misfit) or median(misfit) > _LARGEST_MISFIT:
        raise NoFringesError(
            'what is lit does not look like the fringes of this pattern: check that the pattern '
            'is projected, in focus, and the one that the software was told'
        )
