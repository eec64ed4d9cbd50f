"""How much more the light of coded fringes is blurred than expected, over a surface.

A blur rounds the steps of the contrast. In each window, light is fitted by a level and the
fringes, which takes their shift along; what that leaves of the light is compared with what it
leaves of the change that more blur would make. The excess is a plane over the image: a projector
is in focus at one distance, and a skin is inclined.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import fringe_order
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import ContrastModel
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Between those blurs over which the change is taken, radians^2.
_CHANGE = 0.2
# Rows that it is measured in, and that are judged together.
_ROWS, _TOGETHER = 32, 8
# Standard deviation of what blurs of lenses differ by from the one expected, radians^2: in the
# middle, and from there to the rim of the image.
_SPREAD, _LEAN = 0.2, 0.1
# Share of a window that must be seen, and of a fringe's variation that is left then.
_LEAST_SHARE, _LEAST_VARIATION = 0.7, 0.05
# Times the median misfit from which on a place counts for less: paint and edges lean it.
_OUTLIER = 2.0
_FITS = 4


@dataclass(frozen=True, eq=False)
class Blur:
    """Excess of the blur, at the nodes.

    Attributes
    ----------
    excess, deviation : ndarray, shape (rows, columns), float32
        Radians^2, and its standard deviation.
    """

    excess: NDArray[np.float32]
    deviation: NDArray[np.float32]


def excess_blur(
    model: ContrastModel,
    grid: Grid,
    windows: Windows,
    levels: NDArray[np.float32],
    phase: NDArray[np.float32],
    mask: NDArray[np.bool_],
    blur: NDArray[np.float32],
) -> Blur:
    """Measure what the blur is more than expected.

    Parameters
    ----------
    model : ContrastModel
    grid : Grid
    windows : Windows
        Those in which the fringes are fitted.
    levels, phase : ndarray, shape (rows, bins), float32
        Grey levels, and absolute phase, radians.
    mask : ndarray, shape (rows, bins), bool
        Bins of the surface.
    blur : ndarray, shape (rows, columns), float32
        Variance that is expected at the nodes, radians^2.
    """
    rows = sampled_rows(len(phase))
    expected = grid.to_bins(blur[rows])
    told, power = _told(model, grid, windows, levels[rows], phase[rows], mask[rows], expected)
    # Of a few rows, each fringe is one witness.
    order = fringe_order(grid.at_nodes(phase[rows]))
    order -= order.min()
    count = int(order.max()) + 1
    place = (np.arange(len(rows)) // _TOGETHER)[:, None] * count + order
    power = np.where(power > 0, power, 0)

    def total(values):
        return np.bincount(place.ravel(), (power * values).ravel())

    weight = total(np.float32(1))
    known = weight > 1e-3 * weight.max(initial=0)
    weight = weight[known]
    v, u = (2 * (np.arange(size) + 0.5) / size - 1 for size in (grid.shape[0], grid.shape[1]))
    at_rows, at_columns = v[rows, None], u[None, :]
    terms = np.stack(
        [
            np.ones(len(weight)),
            *(
                total(np.broadcast_to(each, power.shape))[known] / weight
                for each in (at_columns, at_rows)
            ),
        ],
        axis=1,
    )
    values = total(told)[known] / weight
    plane, covariance = _plane(terms, values, weight)
    everywhere = plane[0] + plane[1] * u[None] + plane[2] * v[:, None]
    field = np.stack(np.broadcast_arrays(1.0, u[None], v[:, None]))
    spread = np.einsum('i...,ij,j...->...', field, covariance, field)
    return Blur(everywhere.astype(np.float32), np.sqrt(spread).astype(np.float32))


def sampled_rows(count: int) -> NDArray[np.intp]:
    """The rows of nodes that are measured in."""
    step = max(1, count // _ROWS)
    return np.arange(step // 2, count, step)


def _plane(terms, values, weight) -> tuple[Any, Any]:
    """Coefficients of a plane through values, drawn to zero by what is known, and covariance."""
    prior = np.diag(1 / np.square([_SPREAD, _LEAN, _LEAN]))
    if not len(values):
        return np.zeros(3), np.linalg.inv(prior)
    weight = weight / weight.max()
    robust = np.ones(len(values))
    plane = np.zeros(3)
    for _ in range(_FITS):
        rest = np.sqrt(weight) * (values - terms @ plane)
        scatter = max(NORMAL_SPREAD * median(np.abs(rest)), 1e-6)
        robust = 1 / np.maximum(np.abs(rest) / (_OUTLIER * scatter), 1)
        normal = (terms.T * (weight * robust)) @ terms / scatter**2 + prior
        plane = np.linalg.solve(normal, (terms.T * (weight * robust)) @ values / scatter**2)
    return plane, np.linalg.inv(normal)


def _told(
    model, grid, windows, levels, phase, mask, variance
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What each node's window tells of the excess, and how well."""
    fringes, shift = np.cos(phase), np.sin(phase)
    wider, more = fringes.copy(), shift.copy()
    for side, basis in ((-_CHANGE / 2, (fringes, shift)), (_CHANGE / 2, (wider, more))):
        model.envelope(variance + np.float32(side)).turn(phase, *basis)
    told, power = told_of(
        grid, windows, levels, mask, (fringes + wider) / 2, (shift + more) / 2, wider - fringes
    )
    return np.float32(_CHANGE) * told, power


def told_of(
    grid: Grid,
    windows: Windows,
    levels: NDArray[np.float32],
    mask: NDArray[np.bool_],
    fringes: NDArray[np.float32],
    shift: NDArray[np.float32],
    change: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """How much of a change of the fringes light shows in the windows, in amplitudes of theirs.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    levels, mask : ndarray, shape (rows, bins)
        Grey levels of some rows, and the bins that count.
    fringes, shift, change : ndarray, shape (rows, bins), float32
        Fringes of the amplitude 1, what a shift adds to them, and what is asked for.

    Returns
    -------
    tuple of ndarray, shape (rows, columns), float32
        How much, and how well it is told; 0 where it is not.
    """
    weight = mask.astype(np.float32)
    fields = [weight, weight * fringes, weight * shift, weight * change, weight * levels]
    plain = [np.ones_like(levels), fields[1], fields[2], change, levels]
    pairs = list(combinations_with_replacement(range(5), 2))[:-1]
    products = np.stack([fields[one] * plain[other] for one, other in pairs])
    sums = dict(zip(pairs, grid.at_nodes(products), strict=True))
    moments = {pair: windows.along_u(each) for pair, each in sums.items()}
    share = moments[0, 0]
    known = share > _LEAST_SHARE
    scale = 1 / np.maximum(share, _LEAST_SHARE)
    mean = [moments[0, j] * scale for j in range(5)]

    def joint(i, j):
        return moments[i, j] * scale - mean[i] * mean[j]

    cc, cs, ss = joint(1, 1), joint(1, 2), joint(2, 2)
    determinant = cc * ss - cs * cs
    known &= determinant > _LEAST_VARIATION
    inverse = 1 / np.maximum(determinant, np.float32(_LEAST_VARIATION))
    cx, sx, cy, sy = joint(1, 3), joint(2, 3), joint(1, 4), joint(2, 4)
    a, b = (ss * cx - cs * sx) * inverse, (cc * sx - cs * cx) * inverse
    amplitude = np.hypot(ss * cy - cs * sy, cc * sy - cs * cy) * inverse
    power = joint(3, 3) - a * cx - b * sx
    along = joint(3, 4) - a * cy - b * sy
    known &= (power > 0) & (amplitude > 1)
    told = along / np.maximum(power * amplitude, np.float32(1e-9))
    return np.where(known, told, 0), np.where(known, power * share, 0)
