"""The red stripe, found by a vote of the rows.

Where green and blue fringes vanish and red ones go on, there is the stripe. A threshold on red
would take white fringes or red paint for it; here each fringe of each row is held against both
its neighbours, and all rows vote by fringe order. A painted edge fails against one neighbour,
and a red spot against the other rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import NoStripeError
from ftp_dent_ros.profilometry.fourier_transform.carrier import Carrier
from ftp_dent_ros.profilometry.fourier_transform.fourier import analytic_signal, phase_of, spectrum
from ftp_dent_ros.profilometry.unwrapping import unwrap

_ROWS = 4
# Seen in hostile scenes (paint, glare, ambient light): the stripe's fringe loses more than 0.9
# of its green and blue, no other more than 0.33.
_LEAST_LOSS = 0.6
_LARGEST_RIVAL = 0.7
_LEAST_SUPPORT = 0.1
# Standard deviations of a vote's noise that it must have: of a hundred fringes, none by luck.
_SURELY = 4.0
# Between neighbouring bins of rows, radians: a quarter of a fringe.
_JUMP = np.pi / 2
# Grey levels of amplitude from which on a row's vote counts in full.
_BRIGHT = 8.0
# A fringe serves as a neighbour if it is at least this share as wide: rims cut fringes.
_WHOLE = 0.6
_TURN = 2 * np.pi

_NOT_SEEN = (
    'the red stripe is not seen (no fringe, or more than one, is red over most rows): '
    'bring it into view on a surface that reflects green and blue'
)


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
    height, width = len(image) // _ROWS, image.shape[1]
    if not height:
        raise NoStripeError(_NOT_SEEN)
    binned = cv2.resize(image[: height * _ROWS], (width, height), interpolation=cv2.INTER_AREA)
    inside = (
        cv2.erode(region.view(np.uint8), np.ones((_ROWS, 1)))[_ROWS // 2 :: _ROWS][:height] > 0
    )
    red = np.ascontiguousarray(binned[..., 0], np.float32)
    other = binned[..., 1:].mean(axis=-1)
    wrapped = phase_of(analytic_signal(spectrum(red), red.shape[1], carrier))
    unwrapped = unwrap(wrapped, inside, jump=_JUMP)
    if not (unwrapped.part >= 0).any():
        raise NoStripeError(_NOT_SEEN)
    fringes = _fringes(unwrapped.phase, unwrapped.part, red, other)
    loss, weight, variance = _losses(fringes)
    chosen = _elect(fringes, loss, weight, variance) & (loss > 0.5)
    if not chosen.any():
        raise NoStripeError(_NOT_SEEN)
    return Stripe(
        fringes.row[chosen] * _ROWS + (_ROWS - 1) / 2,
        fringes.middles(unwrapped.phase, chosen),
    )


@dataclass(frozen=True)
class _Fringes:
    """Each fringe of each row from trough to trough, in reading order; all of shape (fringes,)."""

    row: NDArray[np.intp]
    part: NDArray[np.int32]
    order: NDArray[np.intp]
    red: NDArray[np.float64]
    other: NDArray[np.float64]
    variance: NDArray[np.float64]  # of `other`
    left: NDArray[np.intp]
    width: NDArray[np.intp]

    def middles(
        self, phase: NDArray[np.float32], chosen: NDArray[np.bool_]
    ) -> NDArray[np.float64]:
        """Columns of chosen fringes' middles, by a straight line through the phase over each."""
        middles = []
        for fringe in np.flatnonzero(chosen):
            column = self.left[fringe] + np.arange(self.width[fringe])
            within = phase[self.row[fringe], column] - _TURN * self.order[fringe]
            away = within - within.mean()
            slope = (away @ column) / max(float(away @ away), 1e-12)
            middles.append(column.mean() - within.mean() * slope)
        return np.array(middles)


def _fringes(phase, part, red, other) -> _Fringes:
    """Cut the rows at the troughs and measure each fringe's amplitude in red and the others."""
    place = np.flatnonzero(part >= 0)
    row, column = np.divmod(place, part.shape[1])
    phase, part, red, other = (field.ravel()[place] for field in (phase, part, red, other))
    phase = phase.astype(float)
    order = np.rint(phase / _TURN).astype(np.intp)
    cut = [np.diff(values, prepend=-1) != 0 for values in (row, part, order)]
    first = np.flatnonzero(cut[0] | cut[1] | cut[2])
    count = np.diff(first, append=len(row))

    def mean(values):
        return np.add.reduceat(values, first) / count

    def slopes(x, *ys):
        x_mean = mean(x)
        variance = np.maximum(mean(x * x) - x_mean**2, 1e-12)
        return variance, *((mean(x * y) - x_mean * mean(y)) / variance for y in ys)

    within = phase - _TURN * order
    power, of_red, of_other = slopes(np.cos(within.astype(np.float32)).astype(float), red, other)
    scatter = np.maximum(mean(other * other) - mean(other) ** 2 - of_other**2 * power, 0)
    return _Fringes(
        row=row[first],
        part=part[first],
        order=order[first],
        red=of_red,
        other=of_other,
        variance=scatter / (np.maximum(count - 2, 1) * power),
        left=column[first],
        width=count,
    )


def _losses(fringes: _Fringes) -> tuple[NDArray[np.float64], ...]:
    """Share of green and blue that each fringe lacks against both neighbours, weight, variance."""
    share = fringes.other / np.maximum(fringes.red, 1e-6)
    expected = np.zeros(len(share))
    expected[1:-1] = fringes.red[1:-1] * np.minimum(share[:-2], share[2:])
    left, width, order, part = fringes.left, fringes.width, fringes.order, fringes.part
    between = np.zeros(len(share), bool)
    between[1:-1] = (
        (fringes.row[:-2] == fringes.row[2:])
        & (left[:-2] + width[:-2] == left[1:-1])
        & (left[1:-1] + width[1:-1] == left[2:])
        & (part[:-2] == part[1:-1])
        & (part[2:] == part[1:-1])
        & (np.abs(order[2:] - order[:-2]) == 2)
        & (np.minimum(width[:-2], width[2:]) > _WHOLE * width[1:-1])
    )
    seen = between & (fringes.red > 0) & (expected > 0)
    loss = np.where(seen, 1 - fringes.other / np.where(seen, expected, 1), 0)
    variance = np.where(seen, fringes.variance / np.where(seen, expected, 1) ** 2, 0)
    return np.clip(loss, 0, 1), np.where(seen, np.minimum(expected, _BRIGHT), 0), variance


def _elect(fringes: _Fringes, loss, weight, variance) -> NDArray[np.bool_]:
    """Fringes of the order that wins the vote of its part clearly, and not by noise."""
    low = fringes.order.min()
    orders = int(fringes.order.max() - low) + 1
    index = fringes.part * orders + fringes.order - low
    parts = int(fringes.part.max()) + 1
    support = np.bincount(index, weight, parts * orders).reshape(parts, orders)
    lost = np.bincount(index, weight * loss, parts * orders).reshape(parts, orders)
    enough = _LEAST_SUPPORT * support.max(axis=1, keepdims=True)
    score = lost / np.maximum(support + enough, 1e-6)
    noise = np.bincount(index, weight**2 * variance, parts * orders).reshape(parts, orders)
    noise = np.sqrt(noise) / np.maximum(support + enough, 1e-6)
    best = score.argmax(axis=1)
    rivals = score.copy()
    rivals[np.arange(parts), best] = 0
    first, second = score.max(axis=1), rivals.max(axis=1)
    clear = (first >= _LEAST_LOSS) & (second <= _LARGEST_RIVAL * first)
    clear &= first > _SURELY * noise[np.arange(parts), best]
    return clear[fringes.part] & (fringes.order - low == best[fringes.part])
