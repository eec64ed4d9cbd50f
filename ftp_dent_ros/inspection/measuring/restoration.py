"""What the reconstruction smooths away of a surface, put back as far as its resolution tells."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.patch import Patch

# A Gaussian takes half of a wave whose length is so many of its standard deviations.
_HALVED = 2 * math.pi / math.sqrt(2 * math.log(2))
# Of what is put back: how far resolutions are off, as a part of it.
_DOUBT = 0.7

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

    The surface minus itself smoothed once more is what smoothing took of it, but for what is
    finer; the same of that again is the next order, and bounds the rest (the Neumann series of
    the inverse; van Cittert, Z. Phys. 69, 298, 1931).

    Parameters
    ----------
    patch : Patch
    resolution : float
        Wavelength of which half is left, metres; NaN if it is not known.
    supposed : float
        Then nothing is put back, but what this one would ask for is the doubt.
    """
    told = math.isfinite(resolution)
    sigma = (resolution if told else supposed) / _HALVED / patch.step
    if not sigma > 0.1:
        return Restored(patch, np.zeros_like(patch.depth))
    weight = np.maximum(_blurred(patch.known.astype(float), sigma), 1e-3)

    def taken(values: Field) -> Field:
        smooth = _blurred(np.where(patch.known, values, 0.0), sigma) / weight
        return np.where(patch.known, values - smooth, 0.0)

    first = taken(patch.depth)
    if not told:
        return Restored(patch, np.abs(first))
    second = taken(first)
    doubt = np.hypot(_DOUBT * first, second)
    return Restored(replace(patch, depth=patch.depth + first + second), doubt)


def _blurred(values: Field, sigma: float) -> Field:
    size = 2 * math.ceil(3 * sigma) + 1
    result = cv2.GaussianBlur(values, (size, size), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(result, float)
