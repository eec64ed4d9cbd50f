"""What the reconstruction leaves of a surface, by the resolution that a cloud states."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

#: Fits in Gaussian windows, each of which corrects the ones before, that a cloud comes from if it
# states its resolution: of a wave they leave out (1 - G)^fits.
FITS = 4

Field = NDArray[np.float64]


def shown(depth: Field, step: float, resolution: float) -> Field:
    """What a cloud of a resolution shows of depths along a line, `step` metres apart."""
    sigma = resolution / halved(FITS) / step
    size = 2 * math.ceil(3 * sigma) + 1
    seen = np.zeros_like(depth)
    for _ in range(FITS):
        rest = (depth - seen)[None]
        smooth = cv2.GaussianBlur(rest, (size, 1), sigma, borderType=cv2.BORDER_CONSTANT)
        seen = seen + smooth[0]
    return seen


def halved(fits: int) -> float:
    """Wavelength of which half is left, in standard deviations of the Gaussians."""
    gaussian = 1 - 0.5 ** (1 / fits)
    return math.pi * math.sqrt(2 / -math.log(gaussian))
