"""The fringes' light on a board: taken out of its photograph, and which fringe is which."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern, fringe_order
from ftp_dent_ros.rig.rig import Rig

# Pixels are of one colour where the print is so white, and lit where the light is so strong (of
# its mean); a fringe's colour is the mean of so many of them at least.
_WHITE, _LIT, _FEWEST = 0.9, 1.2, 30
# Contrasts that are read right go with their code like this, over so many fringes at least.
_ALIKE, _FEWEST_FRINGES = 0.8, 12


def smoothed(levels: NDArray, rig: Rig, pattern: Pattern) -> NDArray[np.uint8]:
    """The photograph without its fringes: a window of two periods has a zero at theirs."""
    told = 0 if pattern.axis == 'u' else 1
    period = pattern.period_px * (
        rig.camera.camera_matrix[told, told] / rig.projector.camera_matrix[told, told]
    )
    length = 2 * round(period) + 1
    window = np.hanning(length + 2)[1:-1]
    smooth = cv2.sepFilter2D(levels.astype(np.float32), -1, window, window)
    return np.clip(smooth * (230 / max(float(np.percentile(smooth, 99)), 1e-3)), 0, 255).astype(
        np.uint8
    )


def stripe_order(pattern: Pattern, rgb: NDArray, albedo: NDArray, column: NDArray) -> int:
    """Order that the red fringe has; 0 if the columns are right.

    Parameters
    ----------
    pattern : Pattern
        With a stripe.
    rgb : ndarray, shape (height, width, 3)
        Colours of the board's photograph, growing with the light.
    albedo, column : ndarray, shape (height, width)
        How white the print is at each pixel, 0 to 1, and the projector's column that lights it,
        known up to a whole number of periods.

    Raises
    ------
    CalibrationError
        No stripe is on the board.
    """
    red, green, _ = np.moveaxis(rgb.astype(float), -1, 0)
    light = 2 * np.cos(pattern.phase(column))
    bright = (albedo > _WHITE) & (light > _LIT)
    order = np.rint(pattern.phase(column[bright]) / (2 * np.pi)).astype(int)
    least = int(order.min())
    count = np.bincount(order - least)
    with np.errstate(invalid='ignore', divide='ignore'):
        ratio = np.bincount(order - least, green[bright]) / np.bincount(order - least, red[bright])
    ratio[count < _FEWEST] = np.nan
    if not np.isfinite(ratio).any() or np.nanmin(ratio) > np.nanmedian(ratio) / 2:
        raise CalibrationError(
            'the red stripe is not seen on the board: hold it so that the stripe runs over it'
        )
    return int(np.nanargmin(ratio)) + least


def contrast_order(pattern: Pattern, rgb: NDArray, albedo: NDArray, column: NDArray) -> int:
    """Order that the fringe has whose contrast is that of order 0; otherwise as `stripe_order`."""
    upright = pattern if pattern.axis == 'u' else pattern.transposed
    white = albedo > _WHITE
    level, phase = rgb[..., 0][white].astype(float), pattern.phase(column[white])
    order = fringe_order(phase)
    least = int(order.min())
    halves = []
    for half in (np.cos(phase) > 0, np.cos(phase) <= 0):
        size = int(order.max()) - least + 1
        count = np.bincount(order[half] - least, minlength=size)
        total = np.bincount(order[half] - least, level[half], minlength=size)
        halves.append(np.where(count < _FEWEST, np.nan, total / np.maximum(count, 1)))
    bright, dark = halves
    contrast = (bright - dark) / (bright + dark)
    known = np.flatnonzero(np.isfinite(contrast))
    # The board's rim may cut a fringe's half.
    contrast = np.clip(contrast, *np.nanpercentile(contrast, [10, 90]))
    alike = np.array([])
    if len(known) >= _FEWEST_FRINGES:
        orders = upright.fringe_orders
        shifts = range(int(known[-1]) + least - orders[-1], int(known[0]) + least - orders[0] + 1)
        alike = np.array(
            [
                np.corrcoef(upright.fringe_contrast(known + least - shift), contrast[known])[0, 1]
                for shift in shifts
            ]
        )
    if not len(alike) or alike.max() < _ALIKE:
        raise CalibrationError(
            "the code of the fringes' contrast is not read on the board: see that it is in the "
            'light of this pattern, and in focus'
        )
    return shifts[int(np.argmax(alike))]
