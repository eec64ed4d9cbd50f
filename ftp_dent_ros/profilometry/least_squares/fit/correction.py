"""What a fit leaves of the photograph, in flat-top windows: the correction of its phase."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.polar import angle

# Of the normal equations by missing bins, beyond which their lack is not made up for.
_LEAST_SUPPORT = 0.5
# Variance of noise over what a fit's residual shows of it.
_FITTED = 1.45
# Mean square of the lowest contrast, seen through noise.
_LEAST_POWER = 0.1


@dataclass(frozen=True, eq=False)
class Correction:
    """Fields at the nodes, of shape (rows, columns), float32.

    Attributes
    ----------
    step : ndarray
        Of the phase, radians.
    along : ndarray
        Amplitude of the fringes, grey levels.
    texture : ndarray
        Sine of twice the fringes' phase in the light, amplitudes.
    variance : ndarray
        Of the bins, in amplitudes, by what is left of them.
    in_dark : ndarray
        The same between the crests, weighted by the square of the cosine's negative half.
    support : ndarray
        Share of each window that is seen.
    power : ndarray or 1
        Mean square of the contrast there.
    """

    step: NDArray[np.float32]
    along: NDArray[np.float32]
    texture: NDArray[np.float32]
    variance: NDArray[np.float32]
    in_dark: NDArray[np.float32]
    support: NDArray[np.float32]
    power: NDArray[np.float32] | np.float32

    @classmethod
    def of(
        cls,
        rest: NDArray[np.float32],
        misfit: NDArray[np.float32],
        fringes: tuple[NDArray[np.float32], NDArray[np.float32]],
        modulation: NDArray[np.float32],
        mask: NDArray[np.bool_],
        second: float,
        coded: bool,
        grid: Grid,
        windows: Windows,
        density: float,
    ) -> Correction:
        """Correction of a fit.

        Parameters
        ----------
        rest, misfit : ndarray, shape (rows, bins), float32
            What the fit leaves, in grey levels, and in amplitudes before the light was evened,
            which takes a leap of the albedo off what is left, but not off the phase.
        fringes : tuple of 2 ndarrays, shape (rows, bins), float32
            Their cosine and sine.
        modulation : ndarray, shape (rows, columns), float32
            Amplitude that the fit found, grey levels.
        mask : ndarray, shape (rows, bins), bool
            Bins that count.
        second : float
            Amplitude of the second harmonic over the fringes', which was taken off.
        coded : bool
            Whether the contrast changes with a code.
        grid : Grid
        windows : Windows
        density : float
            Of the pixels' noise at the fringes' frequency, over the mean of all.
        """
        cosine, sine = fringes
        weight = mask.astype(np.float32)
        products = np.empty((6 + coded, *weight.shape), np.float32)
        np.multiply(weight, sine, out=products[0])
        products[0] *= sine
        products[0] *= 2
        np.multiply(misfit, weight, out=products[1])
        products[1] *= products[1]
        np.minimum(cosine, 0, out=products[5])
        products[5] *= products[5]
        products[5] *= products[1]
        seen = rest * weight
        np.multiply(seen, sine, out=products[4])
        np.multiply(products[4], cosine, out=products[2])
        np.multiply(seen, cosine, out=products[3])
        if coded:
            products[6] = weight
        known, spread, double, in_phase, across, dark, *share_of_nodes = grid.at_nodes(products)
        support, power = windows.flat_top(known), np.float32(1)
        if coded:
            share = windows.flat_top(*share_of_nodes)
            power = at_least(support / at_least(share, _LEAST_SUPPORT), _LEAST_POWER)
            support = share
        whole = at_least(support, _LEAST_SUPPORT) * power
        along = modulation + 2 * windows.flat_top(in_phase) / power
        step = angle(-2 * windows.flat_top(across) / whole, along)
        texture = 4 * windows.flat_top(double) / (whole * at_least(modulation, 1))
        texture += np.float32(2 * second) * step
        variance = windows.gaussian(spread, 2) / whole
        # The squares of a cosine's negative half are a quarter of twice a sine's.
        in_dark = windows.gaussian(dark, 2)
        in_dark /= at_least(windows.gaussian(known, 2), _LEAST_POWER) * power * np.float32(0.25)
        for each in (variance, in_dark):
            each *= np.float32(_FITTED * density)
        return cls(step, along, texture, variance, in_dark, support, power)
