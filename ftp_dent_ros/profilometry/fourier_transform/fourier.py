"""Rows to analytic signals through the pass band (eq. 6-10 of the paper)."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fourier_transform.carrier import Carrier

# Share of the band's half width over which its edges fall from 1 to 0: a sharp edge rings.
_ROLL_OFF = 0.4


def spectrum(rows: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Fourier transform of real rows, which it takes as periodic: ends should meet in peace."""
    return scipy.fft.rfft(rows, axis=1)


def pass_band(size: int, carrier: Carrier) -> NDArray[np.float32]:
    """Gain of the band ``[f_c - r, f_c + r]`` at the frequencies of a real FFT of `size`."""
    distance = np.abs(scipy.fft.rfftfreq(size) - carrier.frequency) / carrier.radius
    edge = np.clip((distance - 1 + _ROLL_OFF) / _ROLL_OFF, 0, 1)
    return (np.cos(np.pi / 2 * edge) ** 2).astype(np.float32)


def analytic_signal(
    transform: NDArray[np.complex64], size: int, carrier: Carrier
) -> NDArray[np.complex64]:
    """Fringes as ``b exp(i Phi)``, b their amplitude and Phi their phase (eq. 10).

    Parameters
    ----------
    transform : ndarray, shape (rows, size // 2 + 1), complex64
        What `spectrum` gives for rows of `size` pixels.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (rows, size), complex64
        Phases grow with the projector's columns whatever the carrier's sign.
    """
    gain = pass_band(size, carrier)
    kept = np.flatnonzero(gain)
    band = slice(kept[0], kept[-1] + 1)
    whole = np.zeros((len(transform), size), np.complex64)
    np.multiply(transform[:, band], 2 * gain[band], out=whole[:, band])
    signal = scipy.fft.ifft(whole, axis=1, overwrite_x=True)
    return signal if carrier.sign > 0 else np.conj(signal)


def phase_of(signal: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Wrapped phase of an analytic signal (eq. 11), within [-pi, pi]."""
    return np.arctan2(signal.imag, signal.real)


def background(
    transform: NDArray[np.complex64], size: int, carrier: Carrier
) -> NDArray[np.float32]:
    """Light without the fringes: all below the pass band, shape (rows, size)."""
    below = scipy.fft.rfftfreq(size) < carrier.frequency
    gain = np.where(below, 1 - pass_band(size, carrier), 0).astype(np.float32)
    return scipy.fft.irfft(transform * gain, size, axis=1)
