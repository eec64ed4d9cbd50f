"""Estrada's first-order system, which smooths the phase as it unwraps it along the rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.settings import TAU
from ftp_dent_ros.profilometry.unwrapping import wrap


def estrada(
    wrapped: NDArray[np.float32], region: NDArray[np.bool_], tau: float = TAU
) -> NDArray[np.float32]:
    """Estrada's system, phi_n = phi_n-1 + tau W[psi_n - phi_n-1], there and back.

    A first-order system lags behind a slope; the way back lags to the other side, and the mean
    of both does not.

    Parameters
    ----------
    wrapped : ndarray, shape (rows, columns), float32
        Radians, within [-pi, pi].
    region : ndarray, shape (rows, columns), bool
        Where the phase means something.
    tau : float
        Gain of the system, in (0, 1].

    Returns
    -------
    ndarray, shape (rows, columns), float32
        Continuous along each run of the rows.

    References
    ----------
    J. C. Estrada, M. Servin, J. A. Quiroga, Opt. Express 19, 5126 (2011).
    """
    psi = np.ascontiguousarray(wrapped.T)
    inside = np.ascontiguousarray(region.T)
    there = np.empty_like(psi)
    phi, was_inside = psi[0], np.zeros(len(region), bool)
    for column in range(len(psi)):
        phi = np.where(was_inside, phi + tau * wrap(psi[column] - phi), psi[column])
        there[column], was_inside = phi, inside[column]
    mean = np.empty_like(psi)
    was_inside = np.zeros(len(region), bool)
    for column in range(len(psi) - 1, -1, -1):
        forth = there[column]
        phi = np.where(was_inside, phi + tau * wrap(psi[column] - phi), psi[column])
        mean[column], was_inside = forth + wrap(phi - forth) / 2, inside[column]
    return np.ascontiguousarray(mean.T)
