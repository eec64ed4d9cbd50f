"""Which bins are of a surface: those that its fringes explain, and how far its rim covers them."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Misfit of a bin, in fringe amplitudes and in those of all, beyond which it tells of something
# else than fringes; at the rim, where it may lie half beside the surface, less is allowed.
_MISFIT, _MISFIT_NOISE = 0.25, 4.0
_RIM_MISFIT, _RIM_NOISE = 0.08, 4.0
# Times the misfit allowed at the rim by which a bin's light must differ from the dark, and the
# most of that, amplitudes.
_LIT, _LIT_MOST = 2.0, 1.0
# Fringes of a bin beyond the rim that are not in step with the surface's, in amplitudes of these,
# from which on they are another's: the misfits that are allowed on both sides of a rim.
_OUT_OF_STEP = 0.15
# Row and column that the noise is measured in.
_EVERY, _EVERY_COLUMN = 6, 3


def roughness(misfit: NDArray[np.float32], windows: Windows, grid: Grid) -> NDArray[np.float32]:
    """Root mean square misfit of the bins, in amplitudes, in the window of each node."""
    return np.sqrt(windows.gaussian(grid.at_nodes(np.square(np.clip(misfit, -1, 1)))))


def on_surface(
    misfit: NDArray[np.float32],
    mask: NDArray[np.bool_],
    allowed: NDArray[np.bool_],
    clipped: NDArray[np.bool_],
    cosine: NDArray[np.float32],
    period: float,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Bins that the fit may use, those that lie on the surface, and those that tell so.

    Between fringes the surface is as dark as a shadow that it may end in, and does not tell.

    Parameters
    ----------
    misfit : ndarray, shape (rows, bins), float32
        What the fringes leave, in amplitudes.
    mask, allowed, clipped : ndarray, shape (rows, bins), bool
        Bins of the last fit, those that may be of the surface, and those that are clipped.
    cosine : ndarray, shape (rows, bins), float32
        Light of the model's fringes less its mean, in amplitudes.
    period : float
        Of the fringes, bins.
    """
    size = np.abs(misfit)
    noise = _noise(size, mask)
    good = (size < max(_MISFIT, _MISFIT_NOISE * noise)) & allowed
    closing = np.ones((5, _across(period)), np.uint8)
    body: Any = (good | (clipped & allowed)).view(np.uint8)
    body = cv2.morphologyEx(body, cv2.MORPH_CLOSE, closing)
    core = cv2.erode(body, np.ones((3, int(2 * period) + 1), np.uint8), borderValue=0) > 0
    at_rim = max(_RIM_MISFIT, _RIM_NOISE * noise)
    good &= core | (size < at_rim)
    lit = good & (cosine > min(_LIT * at_rim, _LIT_MOST) - 1)
    told = lit | (core & (good | clipped))
    body = (good | (clipped & core)).view(np.uint8)
    body = cv2.morphologyEx(body, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return good, cv2.morphologyEx(body, cv2.MORPH_CLOSE, closing) > 0, told


def astray(
    misfit: NDArray[np.float32],
    mask: NDArray[np.bool_],
    body: NDArray[np.bool_],
    period: float,
) -> NDArray[np.bool_]:
    """Bins of a surface within 0.6 fringes along u of one that misfits by more than noise.

    Parameters
    ----------
    misfit, mask, period
        As of `on_surface`.
    body : ndarray, shape (rows, bins), bool
        Bins on the surface.
    """
    size = np.abs(misfit)
    beyond: Any = (body & (size > _RIM_NOISE * _noise(size, mask))).view(np.uint8)
    return body & (cv2.dilate(beyond, np.ones((1, _across(period)), np.uint8)) > 0)


def _noise(size: NDArray[np.float32], mask: NDArray[np.bool_]) -> float:
    """Standard deviation of misfits of these sizes where a mask is."""
    sample = size[::_EVERY, ::_EVERY_COLUMN][mask[::_EVERY, ::_EVERY_COLUMN]]
    return NORMAL_SPREAD * median(sample) if len(sample) else 0.0


def between_lit(told: NDArray[np.bool_], period: float) -> NDArray[np.bool_]:
    """Bins that tell of a surface, and the dark ones between them.

    Parameters
    ----------
    told : ndarray, shape (rows, bins), bool
    period : float
        Of the fringes, bins.
    """
    return (
        cv2.morphologyEx(told.view(np.uint8), cv2.MORPH_CLOSE, np.ones((1, _across(period)))) > 0
    )


def beside_steep_rim(body: NDArray[np.bool_], period: float) -> NDArray[np.bool_]:
    """Bins off a surface whose rim passes them so steeply that `rim_cover` sees what is beside.

    Parameters
    ----------
    body : ndarray, shape (rows, bins), bool
    period : float
        Of the fringes, bins.
    """
    along: Any = np.ones((1, 4 * math.ceil(period / 2) + 2), np.uint8)
    near = cv2.dilate(body.view(np.uint8), along) > 0
    filled = cv2.morphologyEx(body.view(np.uint8), cv2.MORPH_CLOSE, along) > 0
    between = np.zeros_like(body)
    np.greater(near[:-2] & near[2:], filled[1:-1], out=between[1:-1])
    return between


def _across(period: float) -> int:
    """Bins along u of a gap in a surface that is closed: a fringe and some."""
    return 2 * math.ceil(0.6 * period) + 1


def rim_cover(
    levels: NDArray[np.float32],
    fringes: NDArray[np.float32],
    body: NDArray[np.bool_],
    allowed: NDArray[np.bool_],
    period: float,
    alone: bool = False,
) -> NDArray[np.float32]:
    """Share of the bins at the rim that the surface covers, by the fringes' amplitude.

    Where another surface's fringes go on, the amplitude does not tell whose they are: none of a
    bin off the surface is said to be covered there.

    Parameters
    ----------
    levels, fringes : ndarray, shape (rows, bins), float32
        Grey levels, and the model's fringes.
    body, allowed : ndarray, shape (rows, bins), bool
        Bins on the surface, and those that may be.
    period : float
        Of the fringes, bins.
    alone : bool
        Whether there is no other surface, as on a relief.
    """
    covered = np.zeros(body.shape, np.float32)
    change = (body[1:] != body[:-1]).any(axis=1)
    at_rim = np.append(change, False) | np.append(False, change)
    if not at_rim.any():
        return covered
    beyond = at_rim.copy()
    beyond[1:] |= at_rim[:-1]
    beyond[:-1] |= at_rim[1:]
    rows = np.flatnonzero(beyond)
    size = 2 * math.ceil(period / 2) + 1
    model = fringes[rows]
    model -= _mean_along_u(model, size)
    seen: Any = levels[rows]
    seen -= _mean_along_u(seen, size)  # light that is not fringes
    energy = at_least(_mean_along_u(model * model, size), 1e-3)
    share = _mean_along_u(seen * model, size) / energy
    covered[rows] = share * allowed[rows]
    covered[~at_rim] = 0
    if alone:
        return covered
    seen -= share * model
    others = np.zeros_like(body)
    others[rows] = _mean_along_u(seen * seen, size) > _OUT_OF_STEP**2 * energy
    others &= ~body
    # The next bins away from the surface.
    shared = np.zeros_like(body)
    shared[1:-1] = (body[2:] & others[:-2]) | (body[:-2] & others[2:])
    covered[shared & ~body] = 0
    return covered


def _mean_along_u(bins: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Means over `size` bins along u: of floats a filter is faster than sums that run on."""
    taps, one = np.full(size, 1 / size, np.float32), np.ones(1, np.float32)
    mean: Any = cv2.sepFilter2D(bins, -1, taps, one)
    return mean
