"""Which order was chosen at each step of the contrast, parted where it changes, at the nodes."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import fringe_order
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.code.contrast_code import ContrastSteps
from ftp_dent_ros.profilometry.least_squares.fringe_orders.pieces import touching

# Fringes, and pixel rows, that are left out where one order passes into another: the contrasts of
# both sides are averaged there.
_BAND, _BAND_ROWS = 2.5, 14.0


def parted(
    choice: NDArray[np.intp], foreign: NDArray[np.bool_], grid: Grid, times: int
) -> NDArray[np.intp]:
    """The choices, -1 where they change.

    Steps that are foreign to their choice and hang together with a change are left out too:
    a corner is finer than what is judged together.

    Parameters
    ----------
    choice : ndarray, shape (rows, fringes), int
        Index of an order at each step; -1 for none.
    foreign : ndarray, shape (rows, fringes), bool
    grid : Grid
    times : int
        How many times as many rows as usual were judged together.
    """
    band: Any = cv2.dilate(
        np.pad((choice[:, 1:] != choice[:, :-1]).astype(np.uint8), ((0, 0), (0, 1))),
        np.ones((1, 2 * round(_BAND) + 1), np.uint8),
    )
    rows = 2 * max(round(times * _BAND_ROWS / grid.rows), 1) + 1
    band |= cv2.dilate(
        np.pad((choice[1:] != choice[:-1]).astype(np.uint8), ((0, 1), (0, 0))),
        np.ones((rows, 1), np.uint8),
    )
    corners = touching(foreign, band > 0).view(np.uint8)
    band |= cv2.dilate(corners, np.ones((rows, 3), np.uint8))
    return np.where(band > 0, -1, choice)


def at_nodes(
    choice: NDArray[np.intp],
    steps: ContrastSteps,
    phase: NDArray[np.float32],
    region: NDArray[np.bool_],
) -> NDArray[np.intp]:
    """Choices at the nodes of a region, shape (rows, columns); -1 beyond, and where is none.

    Parameters
    ----------
    choice : ndarray, shape (rows, fringes), int
        At each of the steps.
    steps : ContrastSteps
    phase : ndarray, shape (rows, columns), float32
        At the nodes, as that of which the steps are, radians.
    region : ndarray, shape (rows, columns), bool
    """
    height, fringes = choice.shape
    label = np.full(region.shape, -1, np.intp)
    row, column = np.nonzero(region)
    place = fringe_order(phase[row, column]) - steps.first
    inside = (row >= steps.top) & (row < steps.top + height)
    row, column, place = (each[inside] for each in (row, column, place))
    label[row, column] = choice[row - steps.top, np.clip(place, 0, fringes - 1)]
    return label
