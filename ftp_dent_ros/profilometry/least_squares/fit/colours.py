"""Fringes of one colour that lie beside those of another, and what paint makes of that.

Lenses of projectors and cameras enlarge colours differently, and panels of three colours are
never quite in register. A rig is calibrated on white: there the phase of all light is the mean of
the colours' phases, each by its share of that light. Paint has other shares, and another phase.
How far the colours lie apart goes with the place in the frame by the lenses' first and third
order, and the photograph itself shows it; so that what paint makes of it is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IN_LUMA, IN_MOSAIC
from ftp_dent_ros.profilometry.least_squares.bins.windows import NO_AVERAGE, Windows, gaussian_of
from ftp_dent_ros.profilometry.least_squares.fit.surface_fit import FittedSurface
from ftp_dent_ros.robust import NORMAL_SPREAD, median

# Pairs of rows of bins that the colours are compared in, about, and windows along u: in twice the
# usual ones no mean level is left.
_PAIRS, _WINDOWS = 4, 2.0
# What is added to normal equations.
_LEAST = 1e-6
# Share of a window that must be seen, and grey levels of an amplitude that gives a phase.
_WHOLE, _LEAST_AMPLITUDE = 0.99, 4.0
# Colours that lie apart by less everywhere, radians, are in register: paint makes
# less than half of it, a twentieth of a millimetre where a fringe is 40 mm of depth.
_IN_REGISTER = 0.01
# Standard errors from which on they are apart; nodes that tell of a colour at least, and that
# are looked at, about; and neighbours that share a window.
_SURE, _LEAST_PLACES, _MOST_PLACES, _ALIKE = 5.0, 100, 1000, 6
_ROUNDS, _OUTLIER = 4, 2.0
# The most that shares are off those of white, for it to be a white that a camera sees so; the
# least part of what is seen that must be; and part of a correction that is not sure.
_WHITE, _LEAST_WHITE, _UNSURE = 0.1, 0.1, 0.1
# Fringes from a red stripe's middle within which green and blue have none.
_STRIPE = 3.0


@dataclass(frozen=True, eq=False)
class _Colours:
    """Amplitudes, shape (3, rows, columns), and phases of red, green and blue at nodes."""

    amplitude: NDArray[np.float32]
    phase: NDArray[np.float32]
    whole: NDArray[np.bool_]


def in_register(
    surfaces: list[FittedSurface],
    photograph: Photograph,
    grid: Grid,
    windows: Windows,
    pattern: Pattern,
) -> list[FittedSurface]:
    """The surfaces with the phase that they would have in white.

    Parameters
    ----------
    surfaces : list of FittedSurface
    photograph : Photograph
    grid : Grid
    windows : Windows
    pattern : Pattern
    """
    if photograph.is_flat and not photograph.mosaic:
        return surfaces
    # Pairs of rows, that a mosaic stays one.
    pairs = 2 * np.arange(grid.height // (2 * grid.rows))
    pairs = pairs[:: max(1, len(pairs) // _PAIRS)]
    if not len(pairs):
        return surfaces
    rows = np.stack([pairs, pairs + 1], axis=1).ravel()
    lines = (rows[:, None] * grid.rows + np.arange(grid.rows)).ravel()
    sample = replace(photograph, pixels=photograph.pixels[lines])
    part = replace(grid, height=len(lines))
    bins, stripe = _bins(sample, part), pattern.code == 'stripe'
    seen = [_colours(bins, each, rows, part, windows, stripe) for each in surfaces]
    places = [_places(each, rows, pattern, grid) for each in surfaces]
    apart = [_apart(seen, places, colour) for colour in (0, 2)]
    if all(each is None for each in apart):
        return surfaces
    white = _white(photograph, seen)
    # Where colours lie apart, what each place has of them is needed.
    bins, rows = _bins(photograph, grid), np.arange(grid.shape[0])
    weights = _weights(photograph)[:, None, None]
    result = []
    for surface in surfaces:
        colours = _colours(bins, surface, rows, grid, windows, stripe, across=True)
        light = weights * colours.amplitude
        shares = light / np.maximum(light.sum(axis=0), np.float32(1e-3))
        lead = np.zeros(grid.shape, np.float32)
        for colour, terms in zip((0, 2), apart, strict=True):
            if terms is not None:
                beside = np.tensordot(terms, _places(surface, rows, pattern, grid), 1)
                lead += ((shares[colour] - white[colour]) * beside).astype(np.float32)
        shift = surface.refined.shift
        variance = shift.variance + np.square(np.float32(_UNSURE) * lead)
        refined = replace(surface.refined, shift=replace(shift, variance=variance))
        result.append(replace(surface, refined=refined, phase=surface.phase - lead))
    return result


def _weights(photograph: Photograph) -> NDArray[np.float32]:
    return np.array(IN_MOSAIC if photograph.mosaic else IN_LUMA, np.float32)


def _places(surface, rows, pattern: Pattern, grid: Grid) -> NDArray[np.float64]:
    """Terms of the projector's column and the image's row, -1 to 1, for lenses of both.

    Those of first and third order are a lens's. The camera's goes by its own columns, which of a
    flat skin are a projective map of the projector's: hence two of second order.
    """
    x = pattern.column(surface.phase[rows]) / pattern.width * 2 - 1
    y = np.broadcast_to(2 * rows[:, None] / grid.shape[0] - 1, x.shape)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, x * x * x, x * y * y])


def _bins(photograph: Photograph, grid: Grid) -> list[NDArray[np.float32]]:
    """Red, green and blue in bins, grey levels."""
    unit = np.float32(photograph.unit)
    if not photograph.mosaic:
        channels = (np.ascontiguousarray(photograph.pixels[..., each]) for each in range(3))
        return [grid.binned(each) * unit for each in channels]
    of_colour: dict[str, list[NDArray[np.float32]]] = {'r': [], 'g': [], 'b': []}
    for colour, row, column in photograph.lattices():
        bins = grid.binned_lattice(photograph.pixels, row, column)
        of_colour[colour].append(bins * unit)
    return [np.mean(each, axis=0) for each in of_colour.values()]


def _colours(bins, surface, rows, grid, windows, stripe, across=False) -> _Colours:
    """The colours' fringes on a surface in some rows of bins."""
    phase = grid.at_bins(surface.phase[rows])
    seen = surface.refined.measured[rows]
    if stripe:
        seen = seen & (np.abs(phase) > np.float32(2 * np.pi * _STRIPE))
    cosine, sine = np.cos(phase), np.sin(phase)
    light = np.stack(
        [np.ones_like(phase), *(each * wave for wave in (cosine, sine) for each in bins)]
    )
    light *= seen
    along_v = windows.sigma_v if across else NO_AVERAGE
    whole, *sums = (
        gaussian_of(each, _WINDOWS * windows.sigma_u, along_v, cv2.BORDER_CONSTANT)
        for each in grid.at_nodes(light)
    )
    p, q = np.stack(sums[:3]), np.stack(sums[3:])
    return _Colours(2 * np.hypot(p, q), np.arctan2(-q, p), whole > _WHOLE)


def _apart(seen: list[_Colours], of_all, colour: int) -> NDArray[np.float64] | None:
    """Phase of a colour less that of green, by place; None where they are in register."""
    places, shifts = [], []
    for each, at in zip(seen, of_all, strict=True):
        strong = np.minimum(each.amplitude[colour], each.amplitude[1]) > _LEAST_AMPLITUDE
        told = each.whole & strong
        shift = each.phase[colour] - each.phase[1]
        shifts.append((shift[told] + np.pi) % (2 * np.pi) - np.pi)
        places.append(at[:, told])
    shift = np.concatenate(shifts)
    every = max(1, len(shift) // _MOST_PLACES)
    x, shift = np.concatenate(places, axis=1)[:, ::every].copy(), shift[::every]
    if len(shift) < _LEAST_PLACES:
        return None
    weight = np.ones(len(shift))
    for _ in range(_ROUNDS):
        weighted = x * weight
        inverse = np.linalg.inv(weighted @ x.T + _LEAST * np.eye(len(x)))
        terms = inverse @ (weighted @ shift)
        found = terms @ x
        if np.abs(found).max() < _IN_REGISTER:
            return None
        rest = shift - found
        spread = NORMAL_SPREAD * median(np.abs(rest)) + 1e-9
        weight = 1 / (1 + np.square(rest / (_OUTLIER * spread)))
    errors = spread * np.sqrt(_ALIKE * np.einsum('ik,ij,jk->k', x, inverse, x))
    return terms if (np.abs(found) > _SURE * errors).any() else None


def _white(photograph: Photograph, seen: list[_Colours]) -> NDArray[np.float64]:
    """Shares of the colours in the light of what is nearly white; of true white if little is."""
    weights = _weights(photograph)
    light = np.concatenate([weights[:, None] * each.amplitude[:, each.whole] for each in seen], 1)
    shares = light / np.maximum(light.sum(axis=0), np.float32(1e-3))
    near = np.abs(shares - weights[:, None]).max(axis=0) < _WHITE
    if np.count_nonzero(near) < _LEAST_WHITE * near.size:
        return weights.astype(float)
    return np.median(shares[:, near], axis=1).astype(float)
