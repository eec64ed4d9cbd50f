"""Whether a rig still holds, from one photograph of a board in the flight's pattern."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.rig_check import (
    ANY_TURN,
    PHASE_LEAST,
    PHASE_PX,
    Check,
    fitted,
    fringe_levels,
    judged,
    linear_photograph,
    scatter,
    turned,
)
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern, fringe_order
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

#: Pixels of a print, a square.
PIXELS = 32

# Pixels are of one colour where the print is so white; a fringe's colour is the mean of so many of
# them at least.
_WHITE, _FEWEST = 0.9, 30
# What is read of a fringe goes with its code like this, over so many fringes at least.
_ALIKE, _FEWEST_FRINGES = 0.8, 12

# Terms of the light: on white its mean, fringes and their second harmonic; on ink, which reflects
# a little, its mean and fringes.
_ON_WHITE, _ON_INK = 5, 3

# Blur of the edges at first, wide, for corners are known to a few camera pixels then; those that
# are tried afterwards, of which the photograph chooses.
_FIRST_BLUR = 2.0
_BLURS = 0.5, 0.8, 1.2, 1.7
# Corners and columns known worse than this tell nothing; camera and projector pixels.
_WORST_PX = 0.5
# Fewer corners, or windows in which fringes are seen, tell not how a board lies.
_FEWEST_WINDOWS = 6

# Corners through fringes are known to this at first and at best; pixels, standard deviation.
_CORNER_FIRST, _CORNER_LEAST = 0.05, 0.01


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


def smoothed(levels: NDArray, rig: Rig, pattern: Pattern) -> NDArray[np.uint8]:
    """The photograph without its fringes: a window of two periods has a zero at theirs."""
    told = 0 if pattern.axis == 'u' else 1
    period = pattern.period_px * (
        rig.camera.camera_matrix[told, told] / rig.projector.camera_matrix[told, told]
    )
    window = np.hanning(2 * round(period) + 3)[1:-1]
    smooth = cv2.sepFilter2D(levels.astype(np.float32), -1, window, window)
    white = max(float(np.percentile(smooth, 99)), 1e-3)
    return np.clip(smooth * (230 / white), 0, 255).astype(np.uint8)


def order_by_code(pattern: Pattern, rgb: NDArray, albedo: NDArray, column: NDArray) -> int:
    """Order that the fringe has whose code is that of order 0; 0 if the columns are right.

    Parameters
    ----------
    pattern : Pattern
    rgb : ndarray, shape (height, width, 3)
        Colours of the board's photograph, growing with the light.
    albedo, column : ndarray, shape (height, width)
        How white the print is at each pixel, 0 to 1, and the projector's column that lights it,
        known up to a whole number of periods.

    Raises
    ------
    CalibrationError
        The code is not seen on the board.
    """
    upright = pattern if pattern.axis == 'u' else pattern.transposed
    white = albedo > _WHITE
    phase, colours = pattern.phase(column[white]), rgb[white].astype(float)
    order = fringe_order(phase)
    least, size = int(order.min()), int(np.ptp(order)) + 1

    def means(part: NDArray[np.bool_], colour: int) -> NDArray[np.float64]:
        count = np.bincount(order[part] - least, minlength=size)
        total = np.bincount(order[part] - least, colours[part, colour], minlength=size)
        return np.where(count < _FEWEST, np.nan, total / np.maximum(count, 1))

    half = np.cos(phase) > 0
    orders = np.array(upright.fringe_orders)
    if pattern.code == 'stripe':
        seen, code = means(half, 1) / means(half, 0), (orders != 0).astype(float)
    else:
        bright, dark = means(half, 0), means(~half, 0)
        contrast = (bright - dark) / (bright + dark)
        # The board's rim may cut a fringe's half.
        seen = np.clip(contrast, *np.nanpercentile(contrast, [10, 90]))
        code = upright.fringe_contrast(orders)
    known = np.flatnonzero(np.isfinite(seen))
    alike = [0.0]
    if len(known) >= _FEWEST_FRINGES:
        known = known[known <= known[0] + len(code) - 1]
        shifts = range(len(code) - int(known[-1] - known[0]))
        with np.errstate(invalid='ignore'):
            found = [np.corrcoef(code[s + known - known[0]], seen[known])[0, 1] for s in shifts]
        alike = list(np.nan_to_num(found))
    best = int(np.argmax(alike))
    if alike[best] < _ALIKE:
        what = 'red stripe' if pattern.code == 'stripe' else "code of the fringes' contrast"
        raise CalibrationError(
            f'the {what} is not seen on the board: see that it is in the light of this pattern, '
            'in focus, and that the stripe runs over it if there is one'
        )
    return least + int(known[0]) - int(orders[best])


def fit_window(
    seen: NDArray,
    albedo: NDArray,
    phase: NDArray,
    contrast: NDArray,
    slope_x: NDArray,
    slope_y: NDArray,
) -> tuple[NDArray[np.float64], float, float, float, float]:
    """Fit the light on white and on ink, and the print's shift, by linear least squares.

    Parameters
    ----------
    seen, albedo : ndarray, shape (m,)
        Levels of the window's pixels, and how white the print is there.
    phase, contrast : ndarray, shape (m,)
        Of the fringes as predicted.
    slope_x, slope_y : ndarray, shape (m,)
        Of the albedo, a pixel.

    Returns
    -------
    shift : ndarray, shape (2,)
        Of the print, pixels.
    shift_px : float
        Standard deviation of its worse part.
    behind : float
        Phase by which the fringes lie behind those predicted, radians.
    behind_rad : float
        Standard deviation of it.
    unexplained : float
        Sum of squares of what is left, levels.
    """
    waves = np.column_stack(
        [
            np.ones_like(phase),
            *(contrast**n * wave(n * phase) for n in (1, 2) for wave in (np.cos, np.sin)),
        ]
    )
    on_ink = waves[:, :_ON_INK]
    terms = still = np.column_stack([albedo[:, None] * waves, (1 - albedo)[:, None] * on_ink])
    for _ in range(3):
        inverse = np.linalg.pinv(terms.T @ terms, hermitian=True)
        numbers = inverse @ (terms.T @ seen)
        left = float(np.square(seen - terms @ numbers).sum())
        variance = np.diag(inverse) * left / max(1, len(seen) - terms.shape[1])
        step = waves @ numbers[:_ON_WHITE] - on_ink @ numbers[_ON_WHITE : _ON_WHITE + _ON_INK]
        terms = np.column_stack([still, -step * slope_x, -step * slope_y])
    strength = max(float(np.hypot(numbers[1], numbers[2])), 1e-9)
    return (
        numbers[-2:],
        float(np.sqrt(variance[-2:].max())),
        float(np.arctan2(numbers[2], numbers[1])),
        float(np.sqrt(variance[1:3].max())) / strength,
        left,
    )


@dataclass(frozen=True, eq=False)
class PrintFit:
    """A board in the flight's pattern, fitted once; NaN where nothing is seen about a corner.

    Attributes
    ----------
    corners : ndarray, shape (n, 2)
        Pixels of the camera, in the order of the board's points.
    points : ndarray, shape (n, 3)
        Where each window's middle lies as the corners alone have the board, metres.
    columns : ndarray, shape (n,)
        Projector pixel along the pattern's axis that lights `points`; up to a whole number of
        periods before these are counted.
    off : ndarray, shape (3,)
        Coefficients of the columns' error over the board.
    misfit : float
        Mean square of what is not explained, levels.
    box : tuple of two slices
        Rows and columns of the photograph with the board.
    column, albedo : ndarray
        At each pixel of the box: the projector's column, and how white the print is.
    """

    corners: NDArray[np.float64]
    points: NDArray[np.float64]
    columns: NDArray[np.float64]
    off: NDArray[np.float64]
    misfit: float
    box: tuple[slice, slice]
    column: NDArray[np.float64]
    albedo: NDArray[np.float64]


class _View:
    """A photograph of a board by a rig in its pattern."""

    def __init__(
        self, rig: Rig, pattern: Pattern, board: Board, image: Photograph | NDArray
    ) -> None:
        self.rig, self.pattern, self.board = rig, pattern, board
        self.levels = fringe_levels(image, rig)
        self.told = 0 if pattern.axis == 'u' else 1

    def recognised(self) -> tuple[NDArray[np.float64], PrintFit]:
        """The print as it is seen, and a first fit: which end, and which colour, fits best."""
        board = self.board
        plain = replace(board, dictionary='', marker=0.0, legacy=False)
        try:
            rough = plain.find_rough(smoothed(self.levels, self.rig, self.pattern))
        except CalibrationError:
            kind = 'ChArUco board' if board.dictionary else 'chessboard'
            raise CalibrationError(
                f'no {kind} of {board.columns}x{board.rows} inner corners is seen whole under '
                'the fringes: check the numbers, the light and that no corner is hidden'
            ) from None
        drawn = albedo_of(board)
        ways = [(drawn, rough), (negative(drawn), rough)]
        if board.dictionary:
            ways = [(drawn, rough), (drawn, rough[::-1].copy())]
        tries = []
        for albedo, corners in ways:
            with suppress(CalibrationError):
                tries.append((albedo, self.fit(albedo, corners, np.zeros(3), _FIRST_BLUR)))
        if not tries:
            raise CalibrationError('the fringes are not seen on the board: light the whole of it')
        return min(tries, key=lambda each: each[1].misfit)

    def fit(self, albedo: NDArray, corners: NDArray, off: NDArray, blur: float) -> PrintFit:
        """Fit each corner's window with the board where `corners` have it."""
        rig, pattern, board = self.rig, self.pattern, self.board
        known = np.isfinite(corners[:, 0])
        if known.sum() < _FEWEST_WINDOWS:
            raise CalibrationError(
                f'fewer than {_FEWEST_WINDOWS} corners of the board are seen: light the whole '
                'of it'
            )
        turn, shift = _pose(rig, board.points[known], corners[known])
        points = turn.apply(board.points) + shift
        normal = turn.apply([0.0, 0.0, 1.0])
        middles = rig.camera.project(points)
        # A window's side over the square's, so that no pixel is in two.
        half = max(4, int(0.95 / 2 * board.spacing(middles)))
        low = np.maximum(np.floor(middles.min(axis=0)).astype(int) - half - 2, 0)
        high = np.ceil(middles.max(axis=0)).astype(int) + half + 3
        seen = self.levels[low[1] : high[1], low[0] : high[0]]
        box = slice(low[1], low[1] + seen.shape[0]), slice(low[0], low[0] + seen.shape[1])
        v, u = np.mgrid[box]
        rays = rig.camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2))
        on = rays * ((shift @ normal) / (rays @ normal))[:, None]
        place = turn.inv().apply(on - shift)[:, :2]
        lit_by = rig.projector.project(rig.to_projector(on))
        column = (lit_by[:, self.told] + _plane(board, place) @ off).reshape(u.shape)
        upright = pattern.transposed if self.told else pattern
        phase = pattern.phase(column)
        along = lit_by[:, 1 - self.told].reshape(u.shape)
        contrast = upright.contrast(phase) * upright.row_contrast(along)
        at = ((place / board.square + 1.5) * PIXELS - 0.5).astype(np.float32).reshape(*u.shape, 2)
        soft = gaussian_filter(albedo, blur * PIXELS / board.spacing(middles)).astype(np.float32)
        white = cv2.remap(soft, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=1.0).astype(
            float
        )
        slopes = np.gradient(white)[::-1]
        found = np.full((len(points), 3), np.nan)
        misfit, pixels = 0.0, 0
        for index, (x, y) in enumerate(np.rint(middles).astype(int) - low):
            if min(x, y) < half or x + half >= seen.shape[1] or y + half >= seen.shape[0]:
                continue
            window = slice(y - half, y + half + 1), slice(x - half, x + half + 1)
            inside = (each[window].ravel() for each in (seen, white, phase, contrast, *slopes))
            moved, moved_px, behind, behind_rad, left = fit_window(*inside)
            misfit, pixels = misfit + left, pixels + (2 * half + 1) ** 2
            if behind_rad * pattern.period_px / (2 * np.pi) < _WORST_PX:
                found[index, 2] = behind
            if moved_px < _WORST_PX and np.hypot(*moved) < half:
                found[index, :2] = moved
        behinds = found[:, 2]
        lit = np.isfinite(behinds)
        if lit.sum() < _FEWEST_WINDOWS:
            raise CalibrationError('the fringes are not seen on the board: light the whole of it')
        mean = np.angle(np.nanmean(np.exp(1j * behinds)))
        behinds = mean + np.angle(np.exp(1j * (behinds - mean)))
        terms = _plane(board, board.points[:, :2])
        predicted = rig.projector.project(rig.to_projector(points))[:, self.told] + terms @ off
        late = -behinds * pattern.period_px / (2 * np.pi)
        more, *_ = np.linalg.lstsq(terms[lit], late[lit], rcond=None)
        column = column + (_plane(board, place) @ more).reshape(u.shape)
        return PrintFit(
            middles + found[:, :2],
            points,
            predicted + late,
            off + more,
            misfit / pixels,
            box,
            column,
            white,
        )


def fit_print(rig: Rig, pattern: Pattern, board: Board, image: Photograph | NDArray) -> PrintFit:
    """Corners of a board in the flight's pattern, and the projector's columns there.

    Raises
    ------
    CalibrationError
        The board is not seen whole, or the fringes do not tell their order on it.
    """
    view = _View(rig, pattern, board, image)
    albedo, seen = view.recognised()
    seen = view.fit(albedo, seen.corners, seen.off, _BLURS[1])
    rgb = linear_photograph(image, rig).rgb()[seen.box]
    order = order_by_code(pattern, rgb, seen.albedo, seen.column)
    off = seen.off - [order * pattern.period_px, 0, 0]
    sharp = [view.fit(albedo, seen.corners, off, blur) for blur in _BLURS]
    return min(sharp, key=lambda each: each.misfit)


def _pose(rig: Rig, points: NDArray, corners: NDArray) -> tuple[Rotation, NDArray[np.float64]]:
    """Of a board in the camera's frame."""
    _, turn, shift = cv2.solvePnP(points, corners, rig.camera.camera_matrix, rig.camera.distortion)
    return Rotation.from_rotvec(np.ravel(turn)), np.ravel(shift).astype(float)


def _plane(board: Board, place: NDArray) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(place)), place / board.points[-1, :2] - 0.5])


def check_by_board(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    image: Photograph | NDArray,
    flatness: float = 1e-4,
) -> Check:
    """Check a rig by a photograph of a board.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    board : Board
        The one that the rig was calibrated with, or one whose squares are as well known.
    image : Photograph or ndarray
    flatness : float
        How far the board's border may lie off the plane of its middle, metres, standard
        deviation.

    Raises
    ------
    CalibrationError
        The board is not seen, or too little of it was measured.
    """
    told = 0 if pattern.axis == 'u' else 1
    seen = fit_print(rig, pattern, board, image)
    lit, known = np.isfinite(seen.columns), np.isfinite(seen.corners[:, 0])
    corners, points, columns = seen.corners[known], seen.points[lit], seen.columns[lit]
    rays = points / points[:, 2:]
    x, y = (2 * _plane(board, board.points[:, :2])[:, 1:]).T
    bending = np.stack([x * x, x * y, y * y], axis=1) / 2

    def misfit(unknowns: NDArray) -> list[NDArray]:
        pose, scale, bend = unknowns[3:9], unknowns[9], bending @ unknowns[10:]
        turn = Rotation.from_rotvec(pose[:3])
        bent = board.points * scale + np.outer(bend, [0, 0, 1])
        off = rig.camera.project(turn.apply(bent[known]) + pose[3:]) - corners
        normal = turn.apply([0.0, 0.0, 1.0])
        depth = (pose[3:] @ normal + bend[lit]) / (rays @ normal)
        by = turned(rig, unknowns[:3])
        pixel = by.projector.project(by.to_projector(depth[:, None] * rays))[:, told]
        # Warmth and damp make a print so much larger or smaller: aluminium by 12, paper by 30
        # kelvin.
        prior = [*unknowns[:3] / ANY_TURN, (scale - 1) / 3e-4, *unknowns[10:] / flatness]
        return [off[:, 0], off[:, 1], pixel - columns, np.array(prior)]

    def corner_noise(off: NDArray) -> float:
        grid = np.full(board.rows * board.columns, np.nan)
        grid[known] = off
        return _corner_noise(grid.reshape(board.rows, board.columns))

    turn, shift = _pose(rig, board.points[known], corners)
    found, covariance = fitted(
        misfit,
        np.concatenate([np.zeros(3), turn.as_rotvec(), shift, [1.0], np.zeros(3)]),
        [_CORNER_FIRST, _CORNER_FIRST, PHASE_PX, 1.0],
        [corner_noise, corner_noise, lambda off: scatter(off, PHASE_LEAST), None],
    )
    # A lens that has changed moves most corners, a shadow or the frame's rim a few: the nearest of
    # them tell, which are this part of the mean square of normally distributed vectors in the
    # plane: 1 - q exp(-q) / (1 - exp(-q)), with q = ln 5.
    near = np.sort(np.hypot(*misfit(found)[:2]))[: max(1, int(0.8 * known.sum()))]
    result = judged(rig, pattern, found[:3], covariance, np.median(points, axis=0))
    return replace(result, camera_px=float(np.sqrt(np.mean(near**2) / 0.598)))


def _corner_noise(off: NDArray) -> float:
    """Of residuals (rows, columns) as if they were independent: edges along fringes err alike.

    The variance of a mean of residuals that fade with the distance by a factor r a corner is
    (1 + r) / (1 - r) times as large along each axis.
    """
    spread = scatter(off[np.isfinite(off)], _CORNER_LEAST)
    off = np.clip(off, -3 * spread, 3 * spread)
    factor = 1.0
    for first, second in ((off[1:], off[:-1]), (off[:, 1:], off[:, :-1])):
        ratio = np.nanmean(first * second) / np.nanmean(off**2)
        # Neighbouring corners that err more alike than this are one; their correlation.
        ratio = np.clip(ratio, 0, 0.8)
        factor *= (1 + ratio) / (1 - ratio)
    return float(np.sqrt(np.nanmean(off**2) * factor))
