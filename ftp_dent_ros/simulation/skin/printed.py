"""A print on a panel: a calibration board's squares and markers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.boards.board import Board
from ftp_dent_ros.simulation.skin.paint import Paint

_FEWEST_PIXELS = 40  # of the print, a square


@dataclass(frozen=True, eq=False)
class Print(Paint):
    """Ink where an image is dark: there the albedo is `albedo_beyond`.

    Attributes
    ----------
    ink : ndarray, shape (rows, columns), bool
    pixel : float
        Side of the image's pixels on the panel, metres.
    origin : tuple of 2 floats
        Panel coordinates of the image's upper left corner, metres.
    """

    albedo: tuple[float, float, float] = (0.85, 0.85, 0.85)
    albedo_beyond: tuple[float, float, float] = (0.05, 0.05, 0.05)
    ink: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((1, 1), bool))
    pixel: float = 0.001
    origin: tuple[float, float] = (0.0, 0.0)

    def beyond_edge(self, x: NDArray, y: NDArray) -> NDArray[np.bool_]:
        """Mask of panel coordinates that are inked."""
        place = [
            np.floor((np.nan_to_num(along) - first) / self.pixel).astype(np.intp)
            for along, first in zip((x, y), self.origin, strict=True)
        ]
        rows, columns = self.ink.shape
        inside = (place[0] >= 0) & (place[0] < columns) & (place[1] >= 0) & (place[1] < rows)
        return inside & self.ink[np.clip(place[1], 0, rows - 1), np.clip(place[0], 0, columns - 1)]


def board_print(board: Board) -> Print:
    """A calibration board's print; its first inner corner is the panel's origin."""
    origin = (-1.5 * board.square, -1.5 * board.square)
    pixels = board.exact_pixels(_FEWEST_PIXELS)
    ink = board.draw(pixels) < 128
    return Print(ink=ink, pixel=board.square / pixels, origin=origin)
