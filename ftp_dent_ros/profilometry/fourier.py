"""Rows to analytic signals through the pass band (eq. 6-10)."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.carrier import Carrier

# Share of the band's half width over which its edges fall from 1 to 0: a sharp edge rings.
_ROLL_OFF = 0.4


def pass_band(size: int, carrier: Carrier) -> NDArray[np.float32]:
    """Gain of the band ``[f_c - r, f_c + r]`` at the frequencies of a real FFT of `size`."""
    distance = np.abs(scipy.fft.rfftfreq(size) - carrier.frequency) / carrier.radius
    edge = np.clip((distance - 1 + _ROLL_OFF) / _ROLL_OFF, 0, 1)
    return (np.cos(np.pi / 2 * edge) ** 2).astype(np.float32)


def analytic_signal(rows: NDArray[np.float32], carrier: Carrier) -> NDArray[np.complex64]:
    """Fringes of each row as ``b exp(i Phi)``, b their amplitude and Phi their phase.

    Parameters
    ----------
    rows : ndarray, shape (rows, columns), float32
        Grey levels. The transform takes a row as periodic: its ends should meet in peace.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (rows, columns), complex64
        Phases grow with the projector's columns whatever the carrier's sign.
    """
    size = rows.shape[1]
    spectrum = scipy.fft.rfft(rows, axis=1)
    kept = np.flatnonzero(pass_band(size, carrier))
    whole = np.zeros((len(rows), size), np.complex64)
    first, last = kept[0], kept[-1] + 1
    whole[:, first:last] = 2 * pass_band(size, carrier)[first:last] * spectrum[:, first:last]
    signal = scipy.fft.ifft(whole, axis=1, overwrite_x=True)
    return signal if carrier.sign > 0 else np.conj(signal)
