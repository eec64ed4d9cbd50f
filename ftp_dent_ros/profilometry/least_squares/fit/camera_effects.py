"""What a camera's curve, and averaging its pixels, do to fringes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows

# Row that the harmonics are measured in; in amplitudes, what windows take off well enough.
_EVERY = 6
_LEAST_HARMONICS = 1e-3
# Windows that light's growth is a mean over, the share of one that must be seen, and the most
# that light grows a pixel, but at edges of paint.
_LIGHT, _LEAST_SEEN = 4.0, 0.01
_STEEPEST_LIGHT = 0.003
# Square of a frequency that is none, (radians a pixel)^2.
_LEAST_FREQUENCY = 1e-6


def take_harmonics(
    rest: NDArray[np.float32],
    amplitude: NDArray[np.float32],
    cosine: NDArray[np.float32],
    mask: NDArray[np.bool_],
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
    """
    rows = slice(None, None, _EVERY)
    weight, c = amplitude[rows] * mask[rows], cosine[rows]
    second, third = weight * (2 * c * c - 1), weight * c * (4 * c * c - 3)
    basis = np.stack([second.ravel(), third.ravel()])
    (of_second, both), (_, of_third) = basis @ basis.T + np.eye(2, dtype=np.float32)
    p, q = basis @ rest[rows].ravel()
    determinant = of_second * of_third - both * both
    h2, h3 = (of_third * p - both * q) / determinant, (of_second * q - both * p) / determinant
    if abs(h2) + abs(h3) < _LEAST_HARMONICS:
        return 0.0
    # h2 (2 c^2 - 1) + h3 c (4 c^2 - 3), after Horner.
    shape = cosine * (4 * h3)
    shape += 2 * h2
    shape *= cosine
    shape -= 3 * h3
    shape *= cosine
    shape -= h2
    shape *= amplitude
    rest -= shape
    return float(h2)


def lag_of_blur(
    modulation: NDArray[np.float32],
    told: NDArray[np.bool_],
    phase: NDArray[np.float32],
    grid: Grid,
    windows: Windows,
    usual: NDArray[np.float32],
    of_stripe: float,
    of_code: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Phase at the nodes by which blurred light leads, and its variance.

    Fringes of frequency w, their amplitude growing by g and their frequency by k a pixel, lead by
    c g w + c k (c w^2 + 1) / 2 after a blur of variance c: towards the light, and towards the
    longer fringes, which are blurred less. So do averages over bins. What the projector blurs is
    not yet light of the skin, and does not lead: of a blur beyond that of usual lenses, which may
    be of either, half is taken to be the camera's, or as much more or less.

    Parameters
    ----------
    modulation : ndarray, shape (rows, columns), float32
        At the nodes.
    told : ndarray, shape (rows, columns), bool
        Nodes whose modulation is their own: light does not end where the surface does.
    phase : ndarray, shape (rows, bins), float32
        At the bins.
    grid : Grid
    windows : Windows
    usual : ndarray, shape (rows, columns), float32
        Variance of all blur, that of the bins too, with usual lenses, radians^2.
    of_stripe : float
        Such variance as the stripe shows it, pixels^2; zero if it is not known.
    of_code : ndarray, shape (rows, columns), float32, optional
        As the code shows it, radians^2.

    Returns
    -------
    lag, variance : ndarray, shape (rows, columns), float32
        Radians, radians^2.
    """
    pitch = np.float32(grid.pitch[0])
    here = phase[:, :: grid.bins]
    known = np.zeros(modulation.shape, np.float32)
    known[:, 1:-1] = told[:, 2:] & told[:, 1:-1] & told[:, :-2]
    share = at_least(windows.wide(known, _LIGHT), _LEAST_SEEN)

    def mean(inner):
        field = np.zeros_like(known)
        np.multiply(inner, known[:, 1:-1], out=field[:, 1:-1])
        return windows.wide(field, _LIGHT) / share

    light = np.log(at_least(modulation, 1))
    growth = mean(light[:, 2:] - light[:, :-2]) / (2 * pitch)
    growth = np.clip(growth, -_STEEPEST_LIGHT, _STEEPEST_LIGHT)
    chirp = mean(here[:, 2:] - 2 * here[:, 1:-1] + here[:, :-2]) / (pitch * pitch)
    frequency = np.gradient(here, axis=1) / pitch
    in_phase = np.square(frequency)
    blur = of_stripe * in_phase if of_code is None else of_code
    excess = at_least(blur - usual, 0.0) / at_least(in_phase, _LEAST_FREQUENCY)
    linear, square = growth * frequency + chirp / 2, chirp * in_phase / 2
    half, of_bins = excess / 2, np.float32(grid.bin_variance)
    variance = of_bins + half
    lag = variance * (linear + variance * square)
    return lag, np.square(half * (linear + 2 * variance * square))
