"""A ChArUco board, drawn and found by any OpenCV from 4.6 to 5.

Its functions became classes in 4.7, and are of the main modules since then.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CalibrationError

# Fewer corners do not tell how a board lies.
_FEWEST = 6
# Most pixels that a square is drawn with.
_MOST_PIXELS = 600


class Charuco:
    """A chessboard with markers in its white squares.

    Parameters
    ----------
    squares : (int, int)
        Along x and y.
    square, marker : float
        Their sides, metres.
    dictionary : str
        Name of the markers' dictionary.
    legacy : bool
        Printed by OpenCV before 4.6 with an even number of rows.
    """

    def __init__(
        self, squares: tuple[int, int], square: float, marker: float, dictionary: str, legacy: bool
    ) -> None:
        aruco: Any = cv2.aruco
        words = aruco.getPredefinedDictionary(getattr(aruco, dictionary))
        self._squares = squares
        self._part, self.modules = marker / square, words.markerSize + 2
        self._classes = hasattr(aruco, 'CharucoDetector')
        if not self._classes:
            self._board = aruco.CharucoBoard_create(*squares, square, marker, words)
            return
        self._board = aruco.CharucoBoard(squares, square, marker, words)
        self._board.setLegacyPattern(legacy)

    def draw(self, pixels: int) -> NDArray[np.uint8]:
        """The print without a rim, `pixels` a square."""
        size = (self._squares[0] * pixels, self._squares[1] * pixels)
        image = self._board.generateImage(size) if self._classes else self._board.draw(size)
        return np.asarray(image, np.uint8)

    def exact_pixels(self, least: int) -> int:
        """Pixels a square, not fewer than `least`, that OpenCV draws markers with as they are.

        It rounds their modules and margins to whole pixels.
        """

        def off(pixels: int) -> float:
            side = self._part * pixels
            whole = round(side / self.modules) * self.modules
            return round(abs(side - whole) / pixels, 4) + (pixels - whole) % 2 / pixels

        return min(range(least, _MOST_PIXELS + 1), key=off)

    def find(self, photograph: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Inner corners row by row, shape (n, 2), pixels; NaN where one is not seen.

        Raises
        ------
        CalibrationError
            Too few are seen.
        """
        aruco: Any = cv2.aruco
        found: Any = None
        ids: Any = None
        if self._classes:
            found, ids, _, _ = aruco.CharucoDetector(self._board).detectBoard(photograph)
        else:
            markers, names, _ = aruco.detectMarkers(photograph, self._board.dictionary)
            if names is not None and len(names):
                _, found, ids = aruco.interpolateCornersCharuco(
                    markers, names, photograph, self._board
                )
        corners = np.full(((self._squares[0] - 1) * (self._squares[1] - 1), 2), np.nan)
        if ids is None or len(ids) < _FEWEST:
            raise CalibrationError(
                f'of the ChArUco board {0 if ids is None else len(ids)} corners are seen, fewer '
                f'than {_FEWEST}: check its numbers and dictionary, and show more of it'
            )
        corners[np.asarray(ids).ravel()] = np.asarray(found, float).reshape(-1, 2)
        return corners
