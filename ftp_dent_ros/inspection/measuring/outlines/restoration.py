"""What the reconstruction smooths away of a surface, put back as far as its resolution says."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.skin.smoothing import FITS, halved

#: Of what is put back: how far resolutions are off, as a part of it. What is left out of dents
# goes with the fifth to eighth power of the windows' width, which is stated within 4 %, and of
# what is put back already with the resolution's own.
DOUBT = 0.7

Field = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Restored:
    """A patch, and how far its restoration may be off.

    Attributes
    ----------
    patch : Patch
    doubt : ndarray, shape (rows, columns)
        Standard uncertainty of what was put back or is still missing, metres.
    """

    patch: Patch
    doubt: Field


def restored(patch: Patch, resolution: float, supposed: float) -> Restored:
    """Undo the smoothing to second order, whatever the shape.

    What the fits' windows leave out of the surface as it is was left out of it before, but for
    what is finer; the same of that again is the next order, and bounds the rest (the Neumann
    series of the inverse; van Cittert, Z. Phys. 69, 298, 1931).

    Parameters
    ----------
    patch : Patch
    resolution : float
        Wavelength of which half is left, metres; NaN if it is not known.
    supposed : float
        Then nothing is put back, but what this one would ask for of one Gaussian is the doubt.
    """
    known = math.isfinite(resolution)
    fits = FITS if known else 1
    sigma = (resolution if known else supposed) / halved(fits) / patch.step
    if not sigma > 0.1:
        return Restored(patch, np.zeros_like(patch.depth))
    weight = np.maximum(_blurred(patch.known.astype(float), sigma), 1e-3)

    def taken(values: Field) -> Field:
        for _ in range(fits):
            smooth = _blurred(np.where(patch.known, values, 0.0), sigma) / weight
            values = np.where(patch.known, values - smooth, 0.0)
        return values

    first = taken(patch.depth)
    if not known:
        return Restored(patch, np.abs(first))
    second = taken(first)
    doubt = np.hypot(DOUBT * first, second)
    return Restored(replace(patch, depth=patch.depth + first + second), doubt)


def _blurred(values: Field, sigma: float) -> Field:
    size = 2 * math.ceil(3 * sigma) + 1
    result = cv2.GaussianBlur(values, (size, size), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(result, float)
