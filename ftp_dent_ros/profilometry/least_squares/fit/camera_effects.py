"""What a camera's curve, and averaging its pixels, do to fringes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows

# Row that the harmonics are measured in; in amplitudes, what windows take off well enough.
_EVERY = 6
_LEAST_HARMONICS = 1e-3
# Windows that light is smoothed over, and the most it grows a pixel, but at edges of paint.
_LIGHT = 4.0
_STEEPEST_LIGHT = 0.003


def take_harmonics(
    rest: NDArray[np.float32],
    amplitude: NDArray[np.float32],
    cosine: NDArray[np.float32],
    mask: NDArray[np.bool_],
    grid: Grid,
    work: NDArray[np.float32],
) -> float:
    """Take the second and third harmonic, which a camera's curve makes of fringes, off bins.

    Parameters
    ----------
    rest : ndarray, shape (rows, columns), float32
        What the fringes leave of the bins, grey levels; changed in place.
    amplitude, cosine : ndarray, shape (rows, columns), float32
        Of the fringes.
    mask : ndarray, shape (rows, columns), bool
        Bins to measure in.
    grid : Grid
    work : ndarray, float32
        Workspace of a strip.
    """
    rows = slice(None, None, _EVERY)
    weight, c = amplitude[rows] * mask[rows], cosine[rows]
    second, third = weight * (2 * c * c - 1), weight * c * (4 * c * c - 3)
    basis = np.stack([second.ravel(), third.ravel()])
    normal = basis @ basis.T + np.eye(2, dtype=np.float32)
    h2, h3 = np.linalg.solve(normal, basis @ rest[rows].ravel()).astype(np.float32)
    if abs(h2) + abs(h3) < _LEAST_HARMONICS:
        return 0.0
    # h2 (2 c^2 - 1) + h3 c (4 c^2 - 3), after Horner.
    for rows in grid.strips():
        c = cosine[rows]
        shape = np.multiply(c, 4 * h3, out=work[: len(c)])
        shape += 2 * h2
        shape *= c
        shape -= 3 * h3
        shape *= c
        shape -= h2
        shape *= amplitude[rows]
        rest[rows] -= shape
    return float(h2)


def lag_of_bins(
    modulation: NDArray[np.float32], phase: NDArray[np.float32], grid: Grid, windows: Windows
) -> NDArray[np.float32]:
    """Phase at the nodes by which averaging to bins leads, where light grows along the fringes.

    Parameters
    ----------
    modulation : ndarray, shape (rows, columns), float32
        At the nodes.
    phase : ndarray, shape (rows, bins), float32
        At the bins.
    """
    smooth = windows.wide(np.log(np.maximum(modulation, 1)), _LIGHT)
    growth = np.gradient(smooth, axis=1) / grid.pitch[0]
    frequency = np.gradient(phase[:, :: grid.bins], axis=1) / grid.pitch[0]
    limited = np.clip(growth, -_STEEPEST_LIGHT, _STEEPEST_LIGHT)
    return (limited * frequency * np.float32(grid.bin_variance)).astype(np.float32)
