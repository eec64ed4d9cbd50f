"""Which surfaces are tied to the one that the stripe is on."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.fit.regions import SMALLEST, separated
from ftp_dent_ros.profilometry.least_squares.fringe_orders.frame_rim import FrameRim
from ftp_dent_ros.profilometry.unwrapping import wrap
from ftp_dent_ros.robust import median

# Phase across an edge that is still the same surface, radians.
_TIED = 0.25
# Fringes beyond an edge within which the phases of both sides are compared.
_NEAR = 4.0
_TURN = 2 * math.pi


def joined(
    home: NDArray[np.bool_],
    labels: NDArray[np.integer],
    shift: NDArray[np.float32],
    windows: Windows,
    grid: Grid,
    period: float,
) -> dict[int, int]:
    """Regions that are one surface with another, and the whole turns that part their phases.

    A region beyond an edge, of paint or of the surface, is the same surface if its phase is
    where the slope on this side leads. (A step by whole fringes looks the same.)

    Parameters
    ----------
    home : ndarray, shape (rows, columns), bool
    labels : ndarray, shape (rows, columns), integer
        Other regions, from 1.
    shift : ndarray, shape (rows, columns), float32
        Phase less that of a smooth reference, radians.
    windows : Windows
    grid : Grid
    period : float
        Of the fringes, pixels.

    Returns
    -------
    dict
        Turns to add to the phase of each region that is tied to `home`, by its label.
    """
    if not labels.any():
        return {}
    sizes = np.bincount(labels.ravel())
    waiting = [label for label in range(1, len(sizes)) if sizes[label] >= SMALLEST]
    near = [2 * math.ceil(_NEAR * period / pitch) + 1 for pitch in grid.pitch[::-1]]
    turns: dict[int, int] = {}
    tied, shift = home.copy(), shift.copy()
    while waiting:
        ahead = Extrapolation(tied, windows).by_slope(shift)
        beside = cv2.dilate(tied.view(np.uint8), np.ones(near, np.uint8)) > 0
        found = []
        for label in waiting:
            seam = beside & (labels == label)
            if not seam.any():
                continue
            ahead_by = (ahead - shift)[seam]
            if median(np.abs(wrap(ahead_by))) < _TIED:
                found.append(label)
                turns[label] = round(median(ahead_by) / _TURN)
                shift[labels == label] += np.float32(_TURN * turns[label])
        if not found:
            break
        tied |= np.isin(labels, found)
        waiting = [label for label in waiting if label not in found]
    return turns


def untied(
    region: NDArray[np.bool_],
    lines: NDArray[np.bool_],
    shift: NDArray[np.float32],
    at_stripe: NDArray[np.bool_],
    windows: Windows,
    grid: Grid,
    period: float,
) -> NDArray[np.bool_]:
    """Nodes of a region beyond edges that do not go on from where the stripe is.

    Parameters
    ----------
    region, lines, at_stripe : ndarray, shape (rows, columns), bool
        The region, the edges in it, and the nodes on the stripe.
    shift : ndarray, shape (rows, columns), float32
        Phase less that of a smooth reference, radians.
    windows : Windows
    grid : Grid
    period : float
        Of the fringes, pixels.
    """
    labels, home = _beyond(region, lines, at_stripe)
    alone = np.bincount(labels.ravel()) >= SMALLEST
    alone[0] = False
    if alone.any():
        alone[list(joined(home, labels, shift, windows, grid, period))] = False
    return _nearer(region, home, labels, alone)


def off_frame(
    region: NDArray[np.bool_],
    lines: NDArray[np.bool_],
    at_stripe: NDArray[np.bool_],
    rim: FrameRim,
) -> NDArray[np.bool_]:
    """Nodes of a region beyond edges that end whole fringes off the rim of the frame.

    Parameters
    ----------
    region, lines, at_stripe : ndarray, shape (rows, columns), bool
        The region, the edges in it, faint ones too, and the nodes on the stripe.
    rim : FrameRim
        Of the region.
    """
    labels, home = _beyond(region, lines, at_stripe)
    off = np.zeros(labels.max() + 1, bool)
    off[rim.off(rim.beside(labels))] = True
    return _nearer(region, home, labels, off)


def _beyond(region, lines, at_stripe) -> tuple[Any, NDArray[np.bool_]]:
    """Labels from 1 of the parts of a region beyond edges, and the part that is on the stripe."""
    if not lines.any():
        return np.zeros(region.shape, np.int32), region
    labels: Any
    whole = separated(region, lines)
    _, labels = cv2.connectedComponents(whole.view(np.uint8), connectivity=4)
    at_home = np.bincount(labels[at_stripe & whole], minlength=labels.max() + 1)
    at_home[0] = 0
    if not at_home.any():
        return np.zeros(region.shape, np.int32), region
    home = labels == int(at_home.argmax())
    labels[home] = 0
    return labels, home


def _nearer(region, home, labels, chosen) -> NDArray[np.bool_]:
    """Nodes of the chosen labels, and the slivers along edges and the rim nearest to them."""
    if not chosen.any():
        return np.zeros_like(region)
    foreign = chosen[labels]
    tied = home | ((labels > 0) & ~foreign)
    near, far = (
        cv2.distanceTransform((~part).view(np.uint8), cv2.DIST_L2, 3) for part in (tied, foreign)
    )
    return region & (far < near)
