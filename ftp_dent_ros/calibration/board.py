"""The calibration board, a printed chessboard or ChArUco board, and its corners in photographs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ftp_dent_ros.calibration.descent import descend
from ftp_dent_ros.errors import CalibrationError, ConfigurationError
from ftp_dent_ros.fields import Checked, Limits

# Edges of a photograph in focus are at least this soft: a pixel is a square, pixels.
_SHARPEST = 0.25
# Windows reach this part of the way to the nearest corner, so that one crossing alone is in them.
_WINDOW = 0.6
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)


def refine_corners(
    image: NDArray,
    corners: NDArray[np.float64],
    along: NDArray[np.float64],
    radius: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit two crossing edges about each corner.

    What is seen is ``o + g_x x + g_y y + a erf(s_1) erf(s_2)``, where s_i are the distances to
    the two edges over sqrt(2) times the blur, in even light.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Grey.
    corners : ndarray, shape (n, 2)
        To within a pixel or two.
    along : ndarray, shape (n, 2, 2)
        Directions of the two edges.
    radius : int
        Of the window, pixels.

    Returns
    -------
    corners : ndarray, shape (n, 2)
        NaN where no such crossing is found.
    blur : ndarray, shape (n,)
        Standard deviation of the edges' blur, pixels.
    """
    height, width = image.shape
    whole = np.rint(corners).astype(int)
    inside = ((whole >= radius) & (whole < np.array([width, height]) - radius)).all(axis=1)
    whole[~inside] = radius
    offset = np.arange(-radius, radius + 1)
    rows, columns = whole[:, 1, None, None] + offset[:, None], whole[:, 0, None, None] + offset
    values = image[rows, columns].reshape(len(corners), -1).astype(float)
    x, y = (part.ravel().astype(float) for part in np.meshgrid(offset, offset))
    near = np.hypot(x, y) <= radius + 0.5
    x, y, values = x[near], y[near], values[:, near]
    angles = np.arctan2(along[..., 0], -along[..., 1])  # of the edges' normals
    state = np.zeros((len(corners), 9))
    state[:, :2] = corners - whole
    state[:, 2:4], state[:, 4] = angles, 1.0

    def linearised(state: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        light, jacobian = _model(state, x, y)
        off, turned = light - values, jacobian.transpose(0, 2, 1)
        return np.square(off).sum(axis=1), (turned @ off[..., None])[..., 0], turned @ jacobian

    state = descend(linearised, state, tolerance=1e-6, steps=30)
    found, blur = whole + state[:, :2], np.maximum(state[:, 4], _SHARPEST)
    # A fit that wanders this far has found something else, pixels.
    lost = ~inside | (np.linalg.norm(found - corners, axis=1) > 3.0) | (blur > radius / 2)
    found[lost], blur[lost] = np.nan, np.nan
    return found, blur


def _model(state: NDArray, x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Light in the windows, shape (n, m), and its derivatives, shape (n, m, 9)."""
    cx, cy, first, second, blur, offset, slope_x, slope_y, contrast = state.T[..., None]
    dx, dy = (x - cx)[:, None], (y - cy)[:, None]
    blur = np.maximum(blur, _SHARPEST)
    width = np.sqrt(2) * blur
    angle = np.stack([first, second], axis=1)
    # Of both edges, shape (n, 2, m).
    distance = (np.cos(angle) * dx + np.sin(angle) * dy) / width[:, None]
    turn = (np.cos(angle) * dy - np.sin(angle) * dx) / width[:, None]
    edge, slope = erf(distance), 2 / np.sqrt(np.pi) * np.exp(-distance * distance)
    by = slope * edge[:, ::-1]
    crossing = edge.prod(axis=1)
    light = offset + slope_x * x + slope_y * y + contrast * crossing
    one = np.ones_like(light)
    jacobian = [
        -contrast * (by * np.cos(angle)).sum(axis=1) / width,
        -contrast * (by * np.sin(angle)).sum(axis=1) / width,
        *np.moveaxis(contrast[:, None] * by * turn, 1, 0),
        -contrast * (by * distance).sum(axis=1) / blur,
        *(one, one * x, one * y, crossing),
    ]
    return light, np.stack(jacobian, axis=-1)


@dataclass(frozen=True)
class Board(Checked):
    """A flat board of squares.

    Attributes
    ----------
    columns, rows : int
        Inner corners along the board's x and y.
    square : float
        Side of a square, metres.
    dictionary : str
        ChArUco: name of the markers' dictionary (``DICT_5X5_250``); empty for a chessboard.
    marker : float
        ChArUco: side of a marker, metres.
    legacy : bool
        ChArUco: printed by OpenCV before 4.6 with an even number of rows.

    Raises
    ------
    ConfigurationError
        A value is out of its range.
    """

    columns: Annotated[int, Limits(3, 100)]
    rows: Annotated[int, Limits(3, 100)]
    square: Annotated[float, Limits(0.001, 1.0)]
    dictionary: str = ''
    marker: float = 0.0
    legacy: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.dictionary:
            return
        if not hasattr(cv2, 'aruco'):
            raise ConfigurationError(
                f'OpenCV {cv2.__version__} here has no ArUco: use a chessboard, or '
                'install python3-opencv (apt) or OpenCV 4.7 or later'
            )
        if not hasattr(cv2.aruco, self.dictionary):
            self.refuse('dictionary', 'the name of one of OpenCV, like DICT_5X5_250')
        if not 0 < self.marker < self.square:
            self.refuse('marker', f'metres, less than a square of {self.square:g} m: measure both')

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Corners row by row, shape (n, 3), metres; x right, y down, z into the board."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return (
            np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1).astype(float) * self.square
        )

    def find(self, photograph: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Corners in a photograph.

        Parameters
        ----------
        photograph : ndarray, shape (height, width), uint8
            Grey, evenly lit.

        Returns
        -------
        ndarray, shape (n, 2)
            Pixels (u, v) in the order of `points`; NaN where a corner is not seen.

        Raises
        ------
        CalibrationError
            The board is not found, or not whole where it has no markers.
        """
        coded = bool(self.dictionary)
        corners = self._find_marked(photograph) if coded else self.find_rough(photograph)
        seen = np.isfinite(corners[:, 0])
        window = max(2, int(_WINDOW / 2 * self.spacing(corners)))
        rough = corners[seen].astype(np.float32).reshape(-1, 1, 2)
        fine = cv2.cornerSubPix(photograph, rough, (window, window), (-1, -1), _CRITERIA)
        corners[seen] = np.asarray(fine, float).reshape(-1, 2)
        return self.refine(photograph, corners)[0]

    def refine(
        self, photograph: NDArray, corners: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], float]:
        """Corners that are known to a pixel, as exactly as can be, and the median blur, pixels.

        Parameters
        ----------
        photograph : ndarray, shape (height, width)
        corners : ndarray, shape (n, 2)
            NaN where not seen.
        """
        spacing = self.spacing(corners)
        # Lens distortion bends longer edges.
        radius = int(np.clip(_WINDOW * spacing, 3, 15))
        seen = np.flatnonzero(np.isfinite(corners[:, 0]))
        along = self._directions(corners)
        result = np.full(corners.shape, np.nan)
        result[seen], blur = refine_corners(photograph, corners[seen], along[seen], radius)
        return result, float(np.nanmedian(blur)) if np.isfinite(blur).any() else np.inf

    def _directions(self, corners: NDArray) -> NDArray[np.float64]:
        """Of the two edges at each corner, shape (n, 2, 2): those of the whole board's mapping."""
        seen = np.isfinite(corners[:, 0])
        plane, _ = cv2.findHomography(self.points[seen, :2], corners[seen])
        step = 0.1 * self.square
        ends = [
            cv2.perspectiveTransform((self.points[:, :2] + shift)[None], plane)[0]
            for shift in ([0, 0], [step, 0], [0, step])
        ]
        return np.stack([ends[1] - ends[0], ends[2] - ends[0]], axis=1)

    @cached_property
    def _charuco(self) -> Any:
        """OpenCV's board, which it has made by a class since 4.7."""
        aruco: Any = cv2.aruco
        words = aruco.getPredefinedDictionary(getattr(aruco, self.dictionary))
        given = (self.columns + 1, self.rows + 1), self.square, self.marker, words
        if not hasattr(aruco, 'CharucoDetector'):
            return aruco.CharucoBoard_create(*given[0], *given[1:])
        board = aruco.CharucoBoard(*given)
        board.setLegacyPattern(self.legacy)
        return board

    def _find_marked(self, photograph: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Corners between markers; otherwise as `find`."""
        aruco: Any = cv2.aruco
        board, found = self._charuco, None
        ids: Any = None
        if hasattr(aruco, 'CharucoDetector'):
            found, ids, _, _ = aruco.CharucoDetector(board).detectBoard(photograph)
        else:
            markers, names, _ = aruco.detectMarkers(photograph, board.dictionary)
            if names is not None and len(names):
                _, found, ids = aruco.interpolateCornersCharuco(markers, names, photograph, board)
        ids = np.zeros(0, int) if ids is None else np.ravel(ids)
        # Fewer corners do not tell how a board lies.
        if len(ids) < 6:
            raise CalibrationError(
                f'of the ChArUco board {len(ids)} corners are seen, fewer than 6: check its '
                'numbers and dictionary, and show more of it'
            )
        corners = np.full((self.columns * self.rows, 2), np.nan)
        corners[ids] = np.reshape(np.asarray(found, float), (-1, 2))
        return corners

    def exact_pixels(self, least: int) -> int:
        """Pixels a square, not fewer than `least`, with which `draw` rounds nothing.

        OpenCV rounds the modules and margins of markers to whole pixels.
        """
        if not self.dictionary:
            return least
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        modules = words.markerSize + 2

        def off(pixels: int) -> float:
            side = self.marker / self.square * pixels
            whole = round(side / modules) * modules
            return round(abs(side - whole) / pixels, 4) + (pixels - whole) % 2 / pixels

        return min(range(least, 601), key=off)

    def draw(self, pixels: int) -> NDArray[np.uint8]:
        """The board's print with a white rim of half a square, `pixels` a square."""
        squares = np.indices((self.rows + 1, self.columns + 1)).sum(axis=0) % 2
        large = np.kron(255 * squares, np.ones((pixels, pixels))).astype(np.uint8)
        if self.dictionary:
            board = self._charuco
            draw = board.generateImage if hasattr(board, 'generateImage') else board.draw
            large = np.asarray(draw(large.shape[::-1]), np.uint8)
        image = np.full(((self.rows + 2) * pixels, (self.columns + 2) * pixels), 255, np.uint8)
        half = pixels // 2
        image[half : half + large.shape[0], half : half + large.shape[1]] = large
        return image

    def spacing(self, corners: NDArray) -> float:
        """Smallest distance between neighbouring corners, pixels."""
        grid = corners.reshape(self.rows, self.columns, 2)
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1) for axis in (0, 1)]
        known = np.concatenate([step[np.isfinite(step)] for step in steps])
        return float(known.min()) if len(known) else 6.0

    def find_rough(self, photograph: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Corners of a chessboard to a few pixels; otherwise as `find`."""
        # The search on a large photograph begins on a smaller one; pixels of its longer side.
        scale = max(1.0, max(photograph.shape) / 1300)
        small: Any = cv2.resize(
            photograph, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA
        )
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(small, (self.columns, self.rows), flags=flags)
        if not found:
            # Slower, and finds what blur or uneven light hides from the other.
            found, corners = cv2.findChessboardCornersSB(small, (self.columns, self.rows))
        if not found:
            raise CalibrationError(
                f'no chessboard of {self.columns}x{self.rows} inner corners is seen whole: check '
                'the numbers, the light and that no corner is hidden'
            )
        corners = (np.asarray(corners, float).reshape(-1, 2) + 0.5) * scale - 0.5
        if (self.columns + self.rows) % 2 and not self._first_square_is_dark(photograph, corners):
            corners = corners[::-1].copy()
        return corners

    def _first_square_is_dark(self, photograph: NDArray, corners: NDArray) -> bool:
        """Whether the square between the first corners is darker than that beside it.

        OpenCV begins at either end; where the squares' colours tell the ends apart, so that a
        bend of the board is the same in each pose.
        """
        grid = corners.reshape(self.rows, self.columns, 2)
        levels = []
        for column in (0, 1):
            u, v = np.rint(grid[:2, column : column + 2].mean(axis=(0, 1))).astype(int)
            levels.append(np.median(photograph[v - 1 : v + 2, u - 1 : u + 2]))
        return bool(levels[0] < levels[1])
