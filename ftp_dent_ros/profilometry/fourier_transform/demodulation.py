"""The fringes beyond the region of interest, so that no row ends abruptly.

A row that stops at a panel's rim leaks over the whole spectrum, and the phase is wrong for a
fringe or two along every rim. Here the rest of the row is filled with the reference's fringes,
scaled and shifted to continue what the rim shows, and the row is filtered again: the estimate at
the rim and the fill settle on each other in a few rounds. Pixels within the region that no
fringe explains, as dirt and rivets, are filled likewise with what their surroundings say (R. W.
Gerchberg, Opt. Acta 21, 709, 1974).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.fourier_transform.carrier import Carrier
from ftp_dent_ros.profilometry.fourier_transform.fourier import (
    analytic_signal,
    background,
    spectrum,
)

# Rounds in which what lies beside the region, and what is strange in it, is filled.
_ROUNDS = 4
# Rounds until the fringes can tell which pixels are strange to them.
_SETTLED = 2
# A pixel is explained if it is off by less than this share of the fringes' amplitude.
_EXPLAINED = 0.5
# Of the fringes at a rim, in periods: the first half is still disturbed, the rest is used.
_DISTURBED, _USED = 0.5, 2.0
_BESIDE = np.ones((1, 3), np.uint8)


def demodulate(
    rows: NDArray[np.float32],
    inside: NDArray[np.bool_],
    phase: NDArray[np.float32],
    carrier: Carrier,
) -> tuple[NDArray[np.complex64], NDArray[np.bool_]]:
    """Analytic signal of rows that hold fringes only where `inside`.

    Parameters
    ----------
    rows : ndarray, shape (rows, columns), float32
        Grey levels; what is not `inside` is never looked at.
    inside : ndarray, shape (rows, columns), bool
        The region of interest.
    phase : ndarray, shape (rows, columns), float32
        Absolute phase of the fringes that continue the rows: the virtual reference's, or the
        plain carrier's; radians.
    carrier : Carrier

    Returns
    -------
    signal : ndarray, shape (rows, columns), complex64
        ``b exp(i Phi)``: amplitude in grey levels, and phase.
    explained : ndarray, shape (rows, columns), bool
        Pixels of the region that the fringes explain.
    """
    size = rows.shape[1]
    rims = find_rims(inside)
    outside = np.nonzero(~inside & inside.any(axis=1, keepdims=True))
    beyond = phase[outside]
    filled = np.where(inside, rows, 0)
    signal = np.zeros(rows.shape, np.complex64)
    strange = np.zeros(rows.shape, bool)
    for count in range(_ROUNDS):
        filled[outside] = continued(rims, filled, signal, phase, outside[1], beyond, carrier)
        transform = spectrum(filled)
        signal = analytic_signal(transform, size, carrier)
        if count == _SETTLED - 1:
            misfit = np.abs(rows - background(transform, size, carrier) - signal.real)
            strange = inside & (misfit > _EXPLAINED * np.abs(signal))
            strange = inside & (cv2.dilate(strange.astype(np.uint8), _BESIDE) > 0)
        if strange.any() and count < _ROUNDS - 1:
            light = background(transform, size, carrier)
            filled[strange] = light[strange] + signal[strange].real
    return signal, inside & ~strange


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
    share : ndarray, shape (ends,)
        Pixels outside that are nearer to this end than to any other of their row.
    """

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    inward: NDArray[np.intp]
    length: NDArray[np.intp]
    share: NDArray[np.intp]


def find_rims(inside: NDArray[np.bool_]) -> Rims:
    """Ends of the runs of `inside` along the rows."""
    edges = np.diff(inside.astype(np.int8), axis=1, prepend=0, append=0)
    begin, left = np.nonzero(edges > 0)
    _, right = np.nonzero(edges < 0)
    row = np.repeat(begin, 2)
    column = np.stack([left, right - 1], axis=1).ravel()
    inward = np.tile([1, -1], len(begin))
    first = np.diff(row, prepend=-1) > 0
    last = np.diff(row, append=len(inside)) > 0
    before = np.diff(column, prepend=0) - 1
    after = np.diff(column, append=0) - 1
    to_left = np.where(first, column, before - before // 2)
    to_right = np.where(last, inside.shape[1] - 1 - column, after // 2)
    share = np.where(inward > 0, to_left, to_right)
    return Rims(row, column, inward, np.repeat(right - left, 2), share)


def continued(
    rims: Rims,
    filled: NDArray[np.float32],
    signal: NDArray[np.complex64],
    phase: NDArray[np.float32],
    column: NDArray[np.intp],
    beyond: NDArray[np.float32],
    carrier: Carrier,
) -> NDArray[np.float32]:
    """Grey levels of the pixels outside, each from the nearest rim of its row.

    Next to a rim the signal's shift against the reference is taken as a straight line, its
    amplitude and the light below it as constant.

    Parameters
    ----------
    rims : Rims
    filled, signal, phase : ndarray, shape (rows, columns)
        The rows, their analytic signal so far, and the reference's phase.
    column, beyond : ndarray, shape (pixels,)
        Column of each pixel outside, in reading order, and the reference's phase there.
    carrier : Carrier

    Returns
    -------
    ndarray, shape (pixels,), float32
    """
    step = np.arange(math.ceil(_USED * carrier.period))
    there = step < rims.length[:, None]
    inner = np.where(there, rims.column[:, None] + rims.inward[:, None] * step, 0)
    at = rims.row[:, None], inner
    weight = there & (step >= _DISTURBED * carrier.period)
    weight = np.where(weight.any(axis=1, keepdims=True), weight, there)
    shift = weight * signal[at] * np.exp(-1j * phase[at])
    slope = rims.inward * np.angle((shift[:, 1:] * np.conj(shift[:, :-1])).sum(axis=1))
    offset = rims.inward[:, None] * step
    total = weight.sum(axis=1)
    rim = (shift * np.exp(-1j * slope[:, None] * offset)).sum(axis=1) / total
    level = (weight * (filled[at] - signal[at].real)).sum(axis=1) / total

    def each(values: NDArray) -> NDArray[np.float32]:
        return np.repeat(values.astype(np.float32), rims.share)

    start = np.angle(rim) - slope * rims.column
    angle = beyond + each(start) + each(slope) * column
    return each(level) + each(np.abs(rim)) * np.cos(angle)
