"""The calibration board, a printed chessboard or ChArUco board, and its corners in photographs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ftp_dent_ros.errors import CalibrationError, ConfigurationError
from ftp_dent_ros.fields import Checked, Limits

# Fewer corners do not tell how a board lies.
_FEWEST = 6

# Levenberg and Marquardt's damping: first, and its factor from step to step.
_DAMPING, _FACTOR = 1e-2, 10.0
_STEPS = 25

# Windows reach this part of the way to the nearest corner, so that one crossing alone is in them,
# and these pixels at most: lens distortion bends longer edges.
_WINDOW, _SMALLEST_WINDOW, _LARGEST_WINDOW = 0.6, 3, 15
# A corner search on a large photograph begins on a smaller one; pixels of its longer side.
_SEARCH_SIZE = 1300
_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)


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

        # Most pixels that a square is drawn with.
        return min(range(least, 600 + 1), key=off)

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
    state[:, 5:] = _light(state, x, y, values)
    state = _fit(state, x, y, values)
    moved = np.linalg.norm(state[:, :2] + whole - corners, axis=1)
    # A fit that wanders this far has found something else, pixels.
    lost = ~inside | (moved > 3.0) | (state[:, 4] > radius / 2)
    found = whole + state[:, :2]
    found[lost] = np.nan
    return found, np.where(lost, np.nan, state[:, 4])


def _fit(state: NDArray, x: NDArray, y: NDArray, values: NDArray) -> NDArray[np.float64]:
    damping = np.full(len(state), _DAMPING)
    model, jacobian = _model(state, x, y)
    cost = np.square(values - model).sum(axis=1)
    for _ in range(_STEPS):
        turned = jacobian.transpose(0, 2, 1)
        normal = turned @ jacobian
        gradient = (turned @ (values - model)[..., None])[..., 0]
        diagonal = np.einsum('nii->ni', normal)
        damped = normal + (damping[:, None] * diagonal + 1e-9)[:, :, None] * np.eye(9)
        step = np.linalg.solve(damped, gradient[..., None])[..., 0]
        tried = state + step
        # Edges of a photograph in focus are at least this soft: a pixel is a square, pixels.
        tried[:, 4] = np.maximum(tried[:, 4], 0.25)
        new_model, new_jacobian = _model(tried, x, y)
        new_cost = np.square(values - new_model).sum(axis=1)
        better = new_cost < cost
        state = np.where(better[:, None], tried, state)
        model = np.where(better[:, None], new_model, model)
        jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
        cost = np.where(better, new_cost, cost)
        damping = np.clip(np.where(better, damping / _FACTOR, damping * _FACTOR), 1e-9, 1e9)
        if np.abs(step[:, :2]).max() < 1e-4:
            break
    return state


def _light(state: NDArray, x: NDArray, y: NDArray, values: NDArray) -> NDArray[np.float64]:
    """Offset, slopes and contrast to start from, by linear least squares."""
    _, jacobian = _model(state, x, y)
    linear = jacobian[..., 5:]
    turned = linear.transpose(0, 2, 1)
    normal = turned @ linear + 1e-9 * np.eye(4)
    return np.linalg.solve(normal, turned @ values[..., None])[..., 0]


def _model(state: NDArray, x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Light in the windows, shape (n, m), and its derivatives, shape (n, m, 9)."""
    cx, cy, first, second, blur, offset, slope_x, slope_y, contrast = state.T[..., None]
    dx, dy = x - cx, y - cy
    width = np.sqrt(2) * blur
    edges, slopes, turns = [], [], []
    for angle in (first, second):
        distance = (np.cos(angle) * dx + np.sin(angle) * dy) / width
        edges.append(erf(distance))
        slopes.append(2 / np.sqrt(np.pi) * np.exp(-distance * distance))
        turns.append((distance, (np.cos(angle) * dy - np.sin(angle) * dx) / width))
    by_first, by_second = slopes[0] * edges[1], slopes[1] * edges[0]
    jacobian = np.empty((len(state), len(x), 9))
    jacobian[..., 0] = -contrast * (by_first * np.cos(first) + by_second * np.cos(second)) / width
    jacobian[..., 1] = -contrast * (by_first * np.sin(first) + by_second * np.sin(second)) / width
    jacobian[..., 2] = contrast * by_first * turns[0][1]
    jacobian[..., 3] = contrast * by_second * turns[1][1]
    jacobian[..., 4] = -contrast * (by_first * turns[0][0] + by_second * turns[1][0]) / blur
    jacobian[..., 5] = 1
    jacobian[..., 6], jacobian[..., 7] = x, y
    jacobian[..., 8] = edges[0] * edges[1]
    light = offset + slope_x * x + slope_y * y + contrast * jacobian[..., 8]
    return light, jacobian


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

    @property
    def size(self) -> tuple[int, int]:
        """Inner corners along x and y."""
        return self.columns, self.rows

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Corners row by row, shape (n, 3), metres; x right, y down, z into the board."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return (
            np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1).astype(float) * self.square
        )

    def turned(self) -> Board:
        """The board with rows and columns exchanged."""
        return replace(self, columns=self.rows, rows=self.columns)

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
        corners = self._charuco.find(photograph) if coded else self.find_rough(photograph)
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
        radius = int(np.clip(_WINDOW * spacing, _SMALLEST_WINDOW, _LARGEST_WINDOW))
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

    @property
    def module(self) -> float:
        """ChArUco: side of a marker's cells, of which its black border is one wide, metres."""
        return self.marker / self._charuco.modules

    def exact_pixels(self, least: int) -> int:
        """Pixels a square, not fewer than `least`, with which `draw` rounds nothing."""
        return self._charuco.exact_pixels(least) if self.dictionary else least

    def draw(self, pixels: int) -> NDArray[np.uint8]:
        """The board's print with a white rim of half a square, `pixels` a square."""
        image = np.full(((self.rows + 2) * pixels, (self.columns + 2) * pixels), 255, np.uint8)
        if not self.dictionary:
            row, column = np.indices((self.rows + 1, self.columns + 1))
            squares = np.where((row + column) % 2, 255, 0).astype(np.uint8)
            large = np.kron(squares, np.ones((pixels, pixels), np.uint8))
        else:
            large = self._charuco.draw(pixels)
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
        scale = max(1.0, max(photograph.shape) / _SEARCH_SIZE)
        small = photograph
        if scale > 1:
            small = np.asarray(
                cv2.resize(
                    photograph, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA
                )
            )
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(small, self.size, flags=flags)
        if not found:
            # Slower, and finds what blur or uneven light hides from the other.
            found, corners = cv2.findChessboardCornersSB(small, self.size)
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

    @cached_property
    def _charuco(self) -> Charuco:
        squares = (self.columns + 1, self.rows + 1)
        return Charuco(squares, self.square, self.marker, self.dictionary, self.legacy)
