"""Paint of the skin, as patches are laid on each other by it: without the light."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.survey.patches.resampling import Grid, polynomial

# Light changes slowly along the skin, paint does not: standard deviation of what is taken off,
# metres.
_LIGHT = 0.006
# Logarithm of a paint that is this far from its surroundings tells no more by being farther.
_MOST = 0.7
# Of the window, that must be known: at a rim, to one side of which the skin and its image's own
# windows end, light would be taken for paint.
_LEAST_SHARE = 0.93
# About so many cells tell the light that is taken off first.
_FITTED = 1500


def slopes(field: Grid, pitch: float) -> tuple[Any, Any]:
    """Changes along x and y, central differences; 0 on the outermost cells."""
    scale = 1 / (2 * pitch)
    along_x = cv2.Sobel(field, cv2.CV_32F, 1, 0, ksize=1, scale=scale)
    along_y = cv2.Sobel(field, cv2.CV_32F, 0, 1, ksize=1, scale=scale)
    return along_x, along_y


def paint_of(logarithm: Grid, pitch: float, smooth: float) -> tuple[Grid, Grid]:
    """Paint, its slopes and where it is known, of a logarithm of the skin image.

    Parameters
    ----------
    logarithm : ndarray, shape (rows, columns), float32
        NaN where unknown.
    pitch : float
        Of the grid, metres.
    smooth : float
        Standard deviation that the second paint is smoothed by, cells.

    Returns
    -------
    paint, coarse : ndarray, shape (rows, columns, 4), float32
        Paint, its slopes along x and y (1/m), and 1 where it is known, else 0; the second
        smoothed.
    """
    known = np.isfinite(logarithm)
    share = known.astype(np.float32)
    # What is left of the light is level, so that windows may be one-sided at the rim.
    values = np.where(known, logarithm - _light(logarithm, known), np.float32(0))
    light = _LIGHT / pitch
    window = _mean(share, light)
    around = _mean(values, light) / np.maximum(window, np.float32(1e-3))
    rest = np.clip((values - around) * share, -_MOST, _MOST)
    inside = (share * (window > _LEAST_SHARE)).astype(np.uint8)
    layers = []
    for width in (0.0, smooth):
        if width:
            rest = _blurred(rest, width) / np.maximum(_blurred(share, width), np.float32(1e-3))
        # Beside what is not known, slopes are those of the mask.
        reach = 3 + 2 * math.ceil(width)
        around_it = np.ones((reach, reach), np.uint8)
        mask = cv2.erode(inside, around_it, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        layer = cv2.merge([rest, *slopes(rest, pitch), mask.astype(np.float32)])
        layers.append(layer * layer[..., 3:])
    return layers[0], layers[1]


def _light(logarithm: Grid, known: NDArray[np.bool_]) -> Grid:
    """Polynomial through a logarithm of light, by some of its cells."""
    step = max(1, math.isqrt(np.count_nonzero(known) // _FITTED))
    row, column = np.nonzero(known[::step, ::step])
    if not len(row):
        return np.zeros_like(logarithm)
    place = np.stack([column, row], axis=-1) * float(step)
    through = polynomial(place, logarithm[::step, ::step][row, column][:, None].astype(float))
    rows, columns = (np.arange(float(size)) for size in logarithm.shape)
    return through(columns, rows)[0].astype(np.float32)


def _blurred(field: Grid, sigma: float) -> Grid:
    result: Any = cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return result


def _mean(field: Any, sigma: float) -> Grid:
    """Mean over a wide window, nearly Gaussian: two boxes, which cost the same at any width."""
    side = 2 * round(sigma * np.sqrt(6) / 2) + 1
    for _ in range(2):
        field = cv2.blur(field, (side, side), borderType=cv2.BORDER_CONSTANT)
    return field
