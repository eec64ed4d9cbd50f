"""A board's print: how white it is, and as what it may have been read."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.boards.board import Board

#: Pixels of a print, a square.
PIXELS = 32


def albedo_of(board: Board) -> NDArray[np.float64]:
    """How white the print is, 0 to 1, `PIXELS` a square, with a rim of half a square."""
    size = (board.columns + 2) * PIXELS, (board.rows + 2) * PIXELS
    large = board.draw(board.exact_pixels(PIXELS))
    return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), float) / 255.0


def negative(albedo: NDArray) -> NDArray[np.float64]:
    """A chessboard whose first square is white, or which is seen from its other end."""
    half = PIXELS // 2
    other = albedo.copy()
    other[half:-half, half:-half] = 1 - albedo[half:-half, half:-half]
    return other


def without_markers(board: Board, albedo: NDArray) -> NDArray[np.float64]:
    """The print with each marker's ink spread within its border, which all dictionaries share."""
    plain = albedo.copy()
    margin = (1 - board.marker / board.square) / 2 + board.module / board.square
    inner = round(PIXELS * margin)
    half = PIXELS // 2
    for row in range(half, albedo.shape[0] - half, PIXELS):
        for column in range(half, albedo.shape[1] - half, PIXELS):
            if albedo[row, column] > 0.5:
                marker = plain[
                    row + inner : row + PIXELS - inner, column + inner : column + PIXELS - inner
                ]
                marker[:] = marker.mean()
    return plain
