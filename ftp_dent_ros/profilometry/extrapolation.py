"""The fringes beyond the region of interest, so that no row ends abruptly.

A row that stops at a panel's rim leaks over the whole spectrum, and the phase is wrong for a
fringe or two along every rim. Here the rest of the row is filled with the reference's fringes,
scaled and shifted to continue what the rim shows, and the row is filtered again: the estimate at
the rim and the fill settle on each other in a few rounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.carrier import Carrier
from ftp_dent_ros.profilometry.fourier import analytic_signal

_ROUNDS = 3
# Of the fringes at a rim, in periods: the first half is still disturbed, the rest is used.
_DISTURBED, _USED = 0.5, 2.0


@dataclass(frozen=True)
class Rims:
    """Both ends of every run of region pixels, in reading order: left, right, left, right...

    Attributes
    ----------
    row, column : ndarray, shape (ends,)
        The outermost pixel of the run.
    inward : ndarray, shape (ends,)
        1 at left ends, -1 at right ends.
    length : ndarray, shape (ends,)
        Of the run, pixels.
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    inward: NDArray[np.intp]
    length: NDArray[np.intp]


def demodulate(
    rows: NDArray[np.float32],
    inside: NDArray[np.bool_],
    phase: NDArray[np.float32],
    carrier: Carrier,
) -> NDArray[np.complex64]:
    """Analytic signal of rows that hold fringes only where `inside`.

    Parameters
    ----------
    rows : ndarray, shape (rows, columns), float32
        Grey levels; what is not `inside` is never looked at.
    inside : ndarray, shape (rows, columns), bool
        The region of interest; at least one pixel in every row.
    phase : ndarray, shape (rows, columns), float32
        Absolute phase of the fringes that continue the rows: the virtual reference's, or the
        plain carrier's; radians.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (rows, columns), complex64
    """
    rims = find_rims(inside)
    outside = np.flatnonzero(~inside)
    turned = np.exp(-1j * phase).astype(np.complex64)
    filled = np.where(inside, rows, 0)
    signal = np.zeros(rows.shape, np.complex64)
    for _ in range(_ROUNDS + 1):
        filled.flat[outside] = continued(filled, signal, turned, phase, inside, rims, carrier)
        signal = analytic_signal(filled, carrier)
    return signal


def find_rims(inside: NDArray[np.bool_]) -> Rims:
    """Ends of the runs of `inside` along the rows."""
    edges = np.diff(inside.astype(np.int8), axis=1, prepend=0, append=0)
    row, left = np.nonzero(edges > 0)
    _, right = np.nonzero(edges < 0)
    return Rims(
        row=np.repeat(row, 2),
        column=np.stack([left, right - 1], axis=1).ravel(),
        inward=np.tile([1, -1], len(row)),
        length=np.repeat(right - left, 2),
    )


def continued(filled, signal, turned, phase, inside, rims, carrier):
    """Grey levels of the pixels outside, each from the nearest rim of its row."""
    reach = math.ceil(_USED * carrier.period)
    step = np.arange(reach)
    column = rims.column[:, None] + rims.inward[:, None] * step
    there = step < rims.length[:, None]
    at = rims.row[:, None], np.where(there, column, rims.column[:, None])
    weight = there & (step >= _DISTURBED * carrier.period)
    weight = np.where(weight.any(axis=1, keepdims=True), weight, there).astype(np.float32)
    shift = signal[at] * turned[at]
    pairs = shift[:, 1:] * np.conj(shift[:, :-1]) * (weight[:, 1:] * weight[:, :-1])
    slope = rims.inward * np.angle(pairs.sum(axis=1))
    offset = rims.inward[:, None] * step
    total = weight.sum(axis=1)
    rim = (weight * shift * np.exp(-1j * slope[:, None] * offset)).sum(axis=1) / total
    level = (weight * (filled[at] - signal[at].real)).sum(axis=1) / total
    amplitude, start = np.abs(rim), np.angle(rim)

    count = _shares(inside.shape[1], rims)
    each = np.repeat(np.arange(len(count)), count)
    outside = ~inside
    distance = np.nonzero(outside)[1] - rims.column[each]
    return level[each] + amplitude[each] * np.cos(
        phase[outside] + start[each] + slope[each] * distance
    )


def _shares(columns: int, rims: Rims) -> NDArray[np.intp]:
    """How many pixels outside belong to each rim: the gap between two is halved."""
    first = np.diff(rims.row, prepend=-1) > 0
    last = np.roll(first, -1)
    before = rims.column - np.roll(rims.column, 1) - 1
    after = np.roll(rims.column, -1) - rims.column - 1
    left = np.where(first, rims.column, before - before // 2)
    right = np.where(last, columns - 1 - rims.column, after // 2)
    return np.where(rims.inward > 0, left, right)
