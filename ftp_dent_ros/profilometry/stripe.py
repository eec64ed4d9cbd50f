"""The red stripe, found by a vote of the rows.

Where green and blue fringes vanish and red ones go on, there is the stripe. A threshold on red
would take white fringes or red paint for it; here each fringe of each row is held against both
its neighbours, and all rows vote by fringe order. A painted edge fails against one neighbour,
and a red spot against the other rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.profilometry.carrier import Carrier
from ftp_dent_ros.profilometry.fourier import analytic_signal
from ftp_dent_ros.profilometry.unwrapping import unwrap

_ROWS = 4
# Seen in hostile scenes (paint, glare, ambient light): the stripe's fringe loses more than 0.9
# of its green and blue, no other more than 0.33.
_LEAST_LOSS = 0.6
_LARGEST_RIVAL = 0.7
_LEAST_SUPPORT = 0.1
# Grey levels of amplitude from which on a row's vote counts in full.
_BRIGHT = 8.0
# A fringe is whole if it reaches this near both its troughs (at pi), radians.
_WHOLE = 0.75 * np.pi
_TURN = 2 * np.pi


@dataclass(frozen=True)
class Stripe:
    """Points on the middle of the red stripe.

    Attributes
    ----------
    row, column : ndarray, shape (points,)
        Camera pixels.
    """

    row: NDArray[np.floating]
    column: NDArray[np.floating]


def find_stripe(image: NDArray[np.float32], region: NDArray[np.bool_], carrier: Carrier) -> Stripe:
    """Find the stripe's middle in the rows.

    Parameters
    ----------
    image : ndarray, shape (rows, columns, 3), float32
        RGB.
    region : ndarray, shape (rows, columns), bool
        Where there are fringes.
    carrier : Carrier
        Coarse: within 25 % of the fringes' frequency.

    Raises
    ------
    NoStripeError
        No fringe, or more than one, lacks green and blue in most rows.
    """
    height = len(image) // _ROWS * _ROWS
    binned = image[:height].reshape(-1, _ROWS, *image.shape[1:]).mean(axis=1)
    inside = np.logical_and.reduce(region[:height].reshape(-1, _ROWS, region.shape[1]), axis=1)
    red, other = np.ascontiguousarray(binned[..., 0]), binned[..., 1:].mean(axis=-1)
    wrapped = np.angle(analytic_signal(red, carrier))
    unwrapped = unwrap(wrapped, inside)
    fringes = _fringes(unwrapped.phase, unwrapped.part, red, other)
    loss, weight = _losses(fringes)
    chosen = _elect(fringes, loss, weight) & (loss > 0.5)
    if not chosen.any():
        raise NoStripeError(
            'the red stripe is not seen (no fringe, or more than one, is red over most rows): '
            'bring it into view on a surface that reflects green and blue'
        )
    return Stripe(
        fringes.row[chosen] * _ROWS + (_ROWS - 1) / 2,
        fringes.column[chosen],
    )


@dataclass(frozen=True)
class _Fringes:
    """Each fringe of each row from trough to trough, in reading order; all of shape (fringes,)."""

    row: NDArray[np.intp]
    part: NDArray[np.int32]
    order: NDArray[np.intp]
    column: NDArray[np.float64]
    red: NDArray[np.float64]
    other: NDArray[np.float64]
    whole: NDArray[np.bool_]


def _fringes(phase, part, red, other) -> _Fringes:
    """Cut the rows at the troughs and measure each fringe's amplitude in red and the others."""
    row, column = np.nonzero(part >= 0)
    phase, part = phase[row, column].astype(float), part[row, column]
    order = np.rint(phase / _TURN).astype(np.intp)
    cut = [np.diff(values, prepend=-1) != 0 for values in (row, part, order)]
    first = np.flatnonzero(cut[0] | cut[1] | cut[2])
    count = np.diff(first, append=len(row))

    def mean(values):
        return np.add.reduceat(values, first) / count

    def slope(x, y):
        x_mean, y_mean = mean(x), mean(y)
        variance = np.maximum(mean(x * x) - x_mean**2, 1e-12)
        return (mean(x * y) - x_mean * y_mean) / variance

    within = phase - _TURN * order
    cosine = np.cos(within)
    ends = np.minimum.reduceat(within, first), np.maximum.reduceat(within, first)
    return _Fringes(
        row=row[first],
        part=part[first],
        order=order[first],
        column=mean(column) - mean(within) * slope(within, column),
        red=slope(cosine, red[row, column].astype(float)),
        other=slope(cosine, other[row, column].astype(float)),
        whole=(ends[0] < -_WHOLE) & (ends[1] > _WHOLE),
    )


def _losses(fringes: _Fringes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of green and blue that each fringe lacks against both neighbours, and its weight."""
    share = fringes.other / np.maximum(fringes.red, 1e-6)
    expected = np.zeros(len(share))
    expected[1:-1] = fringes.red[1:-1] * np.minimum(share[:-2], share[2:])
    between = np.zeros(len(share), bool)
    between[1:-1] = (
        (fringes.whole[:-2] & fringes.whole[1:-1] & fringes.whole[2:])
        & (fringes.row[:-2] == fringes.row[2:])
        & (fringes.part[:-2] == fringes.part[2:])
        & (np.abs(fringes.order[2:] - fringes.order[:-2]) == 2)
    )
    seen = between & (fringes.red > 0) & (expected > 0)
    loss = np.where(seen, 1 - fringes.other / np.where(seen, expected, 1), 0)
    return np.clip(loss, 0, 1), np.where(seen, np.minimum(expected, _BRIGHT), 0)


def _elect(fringes: _Fringes, loss, weight) -> NDArray[np.bool_]:
    """Fringes of the order that wins the vote of its part clearly."""
    orders = np.stack([fringes.part, fringes.order], axis=1)
    candidates, index = np.unique(orders, axis=0, return_inverse=True)
    index = index.ravel()
    support = np.bincount(index, weight)
    lost = np.bincount(index, weight * loss)
    part = candidates[:, 0]
    most = np.zeros(part.max(initial=0) + 1)
    np.maximum.at(most, part, support)
    score = lost / np.maximum(support + _LEAST_SUPPORT * most[part], 1e-6)
    elected = np.zeros(len(candidates), bool)
    for label in np.unique(part):
        members = np.flatnonzero(part == label)
        ranking = members[np.argsort(score[members])]
        rival = score[ranking[-2]] if len(ranking) > 1 else 0.0
        best = score[ranking[-1]]
        elected[ranking[-1]] = best >= _LEAST_LOSS and rival <= _LARGEST_RIVAL * best
    return elected[index]
