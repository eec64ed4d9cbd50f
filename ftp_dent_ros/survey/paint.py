"""Paint of the skin, as patches are laid on each other by it: without the light."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.survey.resampling import Grid

# Light changes slowly along the skin, paint does not: standard deviation of what is taken off,
# metres.
_LIGHT = 0.006
# Logarithm of a paint that is this far from its surroundings tells no more by being farther.
_MOST = 0.7
# Of the window, that must be known: at a rim, to one side of which the skin and its image's own
# windows end, light would be taken for paint.
_LEAST_SHARE = 0.93
# What is taken off first: degree in x and y of the light, and about how many cells tell it.
_DEGREE, _FITTED = 3, 1500


def slopes(field: Grid, pitch: float) -> Any:
    """Changes along x and y, central differences."""
    along_y, along_x = np.gradient(field, np.float32(pitch))
    return along_x, along_y


def paint_of(logarithm: Grid, pitch: float, smooth: float) -> Grid:
    """Paint, its slopes and where it is known, of a logarithm of the skin image.

    Parameters
    ----------
    logarithm : ndarray, shape (rows, columns), float32
        NaN where unknown.
    pitch : float
        Of the grid, metres.
    smooth : float
        Standard deviation that the paint is smoothed by, cells.

    Returns
    -------
    ndarray, shape (rows, columns, 4), float32
        Paint, its slopes along x and y (1/m), and 1 where it is known, else 0.
    """
    known = np.isfinite(logarithm)
    share = known.astype(np.float32)
    values = np.where(known, logarithm, np.float32(0))
    # What is left of the light is level, so that windows may be one-sided at the rim.
    values = (values - _light(logarithm, known)) * share
    light = _LIGHT / pitch
    window = _mean(share, light)
    around = _mean(values, light) / np.maximum(window, np.float32(1e-3))
    rest = np.clip((values - around) * share, -_MOST, _MOST)
    if smooth:
        rest = _blurred(rest, smooth) / np.maximum(_blurred(share, smooth), np.float32(1e-3))
    along_x, along_y = slopes(rest, pitch)
    # Beside what is not known, slopes are those of the mask.
    reach = 3 + 2 * int(np.ceil(smooth))
    whole = cv2.erode(share, np.ones((reach, reach), np.uint8), borderValue=0)
    mask = (whole > 0) & (window > _LEAST_SHARE)
    layer = np.dstack([rest, along_x, along_y, mask.astype(np.float32)])
    layer[~mask] = 0
    return layer


def _light(logarithm: Grid, known: NDArray[np.bool_]) -> Grid:
    """Polynomial through a logarithm of light, by some of its cells."""
    rows, columns = (np.linspace(-1, 1, size) for size in logarithm.shape)
    row, column = np.nonzero(known)
    some = slice(None, None, max(1, len(row) // _FITTED))
    row, column = row[some], column[some]
    along_y, along_x = (np.vander(each, _DEGREE + 1) for each in (rows, columns))
    terms = np.einsum('ni,nj->nij', along_y[row], along_x[column]).reshape(len(row), -1)
    weights, *_ = np.linalg.lstsq(terms, logarithm[row, column], rcond=None)
    weights = weights.reshape(_DEGREE + 1, _DEGREE + 1)
    return (along_y @ weights @ along_x.T).astype(np.float32)


def _blurred(field: Grid, sigma: float) -> Grid:
    result: Any = cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return result


def _mean(field: Any, sigma: float) -> Grid:
    """Mean over a wide window, nearly Gaussian: two boxes, which cost the same at any width."""
    side = 2 * round(sigma * np.sqrt(6) / 2) + 1
    for _ in range(2):
        field = cv2.blur(field, (side, side), borderType=cv2.BORDER_CONSTANT)
    return field
