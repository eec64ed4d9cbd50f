"""Whether a rig still holds, from one photograph of a board in the flight's pattern."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.wall_check import (
    ANY_TURN,
    PHASE_LEAST,
    PHASE_PX,
    Check,
    fringe_levels,
    judged,
    linear_photograph,
    scatter,
    turn_covariance,
    turned,
)
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern, fringe_order
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

#: Pixels of a print, a square.
PIXELS = 32

# Pixels are of one colour where the print is so white, and lit where the light is so strong (of
# its mean); a fringe's colour is the mean of so many of them at least.
_WHITE, _LIT, _FEWEST = 0.9, 1.2, 30

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
_PRINT_FIT_FEWEST = 6

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


def smoothed(levels: NDArray, rig: Rig, pattern: Pattern) -> NDArray[np.uint8]:
    """The photograph without its fringes: a window of two periods has a zero at theirs."""
    told = 0 if pattern.axis == 'u' else 1
    period = pattern.period_px * (
        rig.camera.camera_matrix[told, told] / rig.projector.camera_matrix[told, told]
    )
    length = 2 * round(period) + 1
    window = np.hanning(length + 2)[1:-1]
    smooth = cv2.sepFilter2D(levels.astype(np.float32), -1, window, window)
    return np.clip(smooth * (230 / max(float(np.percentile(smooth, 99)), 1e-3)), 0, 255).astype(
        np.uint8
    )


def stripe_order(pattern: Pattern, rgb: NDArray, albedo: NDArray, column: NDArray) -> int:
    """Order that the red fringe has; 0 if the columns are right.

    Parameters
    ----------
    pattern : Pattern
        With a stripe.
    rgb : ndarray, shape (height, width, 3)
        Colours of the board's photograph, growing with the light.
    albedo, column : ndarray, shape (height, width)
        How white the print is at each pixel, 0 to 1, and the projector's column that lights it,
        known up to a whole number of periods.

    Raises
    ------
    CalibrationError
        No stripe is on the board.
    """
    red, green, _ = np.moveaxis(rgb.astype(float), -1, 0)
    light = 2 * np.cos(pattern.phase(column))
    bright = (albedo > _WHITE) & (light > _LIT)
    order = np.rint(pattern.phase(column[bright]) / (2 * np.pi)).astype(int)
    least = int(order.min())
    count = np.bincount(order - least)
    with np.errstate(invalid='ignore', divide='ignore'):
        ratio = np.bincount(order - least, green[bright]) / np.bincount(order - least, red[bright])
    ratio[count < _FEWEST] = np.nan
    if not np.isfinite(ratio).any() or np.nanmin(ratio) > np.nanmedian(ratio) / 2:
        raise CalibrationError(
            'the red stripe is not seen on the board: hold it so that the stripe runs over it'
        )
    return int(np.nanargmin(ratio)) + least


def contrast_order(pattern: Pattern, rgb: NDArray, albedo: NDArray, column: NDArray) -> int:
    """Order that the fringe has whose contrast is that of order 0; otherwise as `stripe_order`."""
    upright = pattern if pattern.axis == 'u' else pattern.transposed
    white = albedo > _WHITE
    level, phase = rgb[..., 0][white].astype(float), pattern.phase(column[white])
    order = fringe_order(phase)
    least = int(order.min())
    halves = []
    for half in (np.cos(phase) > 0, np.cos(phase) <= 0):
        size = int(order.max()) - least + 1
        count = np.bincount(order[half] - least, minlength=size)
        total = np.bincount(order[half] - least, level[half], minlength=size)
        halves.append(np.where(count < _FEWEST, np.nan, total / np.maximum(count, 1)))
    bright, dark = halves
    contrast = (bright - dark) / (bright + dark)
    known = np.flatnonzero(np.isfinite(contrast))
    # The board's rim may cut a fringe's half.
    contrast = np.clip(contrast, *np.nanpercentile(contrast, [10, 90]))
    alike = np.array([])
    # Contrasts that are read right go with their code like this, over so many fringes at least.
    if len(known) >= 12:
        orders = upright.fringe_orders
        shifts = range(int(known[-1]) + least - orders[-1], int(known[0]) + least - orders[0] + 1)
        alike = np.array(
            [
                np.corrcoef(upright.fringe_contrast(known + least - shift), contrast[known])[0, 1]
                for shift in shifts
            ]
        )
    if not len(alike) or alike.max() < 0.8:
        raise CalibrationError(
            "the code of the fringes' contrast is not read on the board: see that it is in the "
            'light of this pattern, and in focus'
        )
    return shifts[int(np.argmax(alike))]


@dataclass(frozen=True, eq=False)
class WindowFit:
    """What a window tells.

    Attributes
    ----------
    shift : ndarray, shape (2,)
        Of the print, pixels.
    shift_px : float
        Standard deviation of its worse part, pixels.
    phase : float
        By which the fringes lie behind those predicted, radians.
    phase_rad : float
        Standard deviation of it, radians.
    unexplained : float
        Sum of squares of what is left, levels.
    """

    shift: NDArray[np.float64]
    shift_px: float
    phase: float
    phase_rad: float
    unexplained: float


def fit_window(
    seen: NDArray,
    albedo: NDArray,
    phase: NDArray,
    contrast: NDArray,
    slope_x: NDArray,
    slope_y: NDArray,
) -> WindowFit:
    """Fit the light on white and on ink, and the print's shift, by linear least squares.

    Parameters
    ----------
    seen, albedo : ndarray, shape (m,)
        Levels of the window's pixels, and how white the print is there.
    phase, contrast : ndarray, shape (m,)
        Of the fringes as predicted.
    slope_x, slope_y : ndarray, shape (m,)
        Of the albedo, a pixel.
    """
    waves = np.column_stack(
        [
            np.ones_like(phase),
            *(contrast**n * wave(n * phase) for n in (1, 2) for wave in (np.cos, np.sin)),
        ]
    )
    on_ink = waves[:, :_ON_INK]
    still = np.column_stack([albedo[:, None] * waves, (1 - albedo)[:, None] * on_ink])
    numbers, _ = _least_squares(still, seen)
    for _ in range(2):
        step = waves @ numbers[:_ON_WHITE] - on_ink @ numbers[_ON_WHITE : _ON_WHITE + _ON_INK]
        terms = np.column_stack([still, -step * slope_x, -step * slope_y])
        numbers, inverse = _least_squares(terms, seen)
    left = float(np.square(seen - terms @ numbers).sum())
    variance = np.diag(inverse) * left / max(1, len(seen) - terms.shape[1])
    strength = max(float(np.hypot(numbers[1], numbers[2])), 1e-9)
    return WindowFit(
        numbers[-2:],
        float(np.sqrt(variance[-2:].max())),
        float(np.arctan2(numbers[2], numbers[1])),
        float(np.sqrt(variance[1:3].max())) / strength,
        left,
    )


def _least_squares(terms: NDArray, seen: NDArray) -> tuple[NDArray, NDArray]:
    """Numbers, and the inverse of the normal equations."""
    inverse = np.linalg.pinv(terms.T @ terms, hermitian=True)
    return inverse @ (terms.T @ seen), inverse


@dataclass(frozen=True, eq=False)
class PrintFit:
    """What is seen about each corner of a board; NaN where nothing is.

    Attributes
    ----------
    corners : ndarray, shape (n, 2)
        Pixels of the camera, in the order of the board's points.
    points : ndarray, shape (n, 3)
        Where each window's middle lies as the corners alone have the board, metres.
    columns : ndarray, shape (n,)
        Projector pixel along the pattern's axis that lights `points`.
    """

    corners: NDArray[np.float64]
    points: NDArray[np.float64]
    columns: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _View:
    """The photograph, and what is known beforehand."""

    rig: Rig
    pattern: Pattern
    board: Board
    levels: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A round of the fit; columns are known up to a whole number of periods."""

    corners: NDArray[np.float64]
    points: NDArray[np.float64]
    columns: NDArray[np.float64]
    off: NDArray[np.float64]  # coefficients of the columns' error over the board
    misfit: float  # mean square of what is not explained, levels
    box: tuple[slice, slice]
    column: NDArray[np.float64]  # at each pixel of the box
    albedo: NDArray[np.float64]


def fit_print(rig: Rig, pattern: Pattern, board: Board, image: Photograph | NDArray) -> PrintFit:
    """Corners of a board in the flight's pattern, and the projector's columns there.

    Raises
    ------
    CalibrationError
        The board is not seen whole, its markers are others, or the fringes do not tell their
        order on it.
    """
    view = _View(rig, pattern, board, fringe_levels(image, rig))
    albedo, seen = _recognised(view)
    seen = _fitted(view, albedo, seen.corners, seen, _BLURS[1])
    rgb = linear_photograph(image, rig).rgb()[seen.box]
    told = stripe_order if pattern.code == 'stripe' else contrast_order
    order = told(pattern, rgb, seen.albedo, seen.column)
    seen = replace(seen, off=seen.off - [order * pattern.period_px, 0, 0])
    sharp = [_fitted(view, albedo, seen.corners, seen, blur) for blur in _BLURS]
    seen = min(sharp, key=lambda each: each.misfit)
    return PrintFit(seen.corners, seen.points, seen.columns)


def _recognised(view: _View) -> tuple[NDArray[np.float64], _Fitted]:
    """The print as it is seen, and a first fit: markers tell the end, squares the colour."""
    board = view.board
    plain = replace(board, dictionary='', marker=0.0, legacy=False)
    try:
        rough = plain.find_rough(smoothed(view.levels, view.rig, view.pattern))
    except CalibrationError:
        kind = 'ChArUco board' if board.dictionary else 'chessboard'
        raise CalibrationError(
            f'no {kind} of {board.columns}x{board.rows} inner corners is seen whole under the '
            'fringes: check the numbers, the light and that no corner is hidden'
        ) from None
    drawn = albedo_of(board)
    ends = [rough]
    prints = [drawn, negative(drawn)]
    if board.dictionary:
        ends.append(rough[::-1].copy())
        prints = [drawn, without_markers(board, drawn)]
    tries = []
    for corners in ends:
        for albedo in prints:
            with suppress(CalibrationError):
                tries.append((albedo, _fitted(view, albedo, corners, None, _FIRST_BLUR)))
    if not tries:
        raise CalibrationError('the fringes are not seen on the board: light the whole of it')
    best, seen = min(tries, key=lambda each: each[1].misfit)
    if board.dictionary and best is not drawn:
        raise CalibrationError(
            f'the squares of a board of {board.columns}x{board.rows} inner corners are seen, but '
            f'not the markers of {board.dictionary} with a side of {1e3 * board.marker:g} mm: '
            'check --charuco, --marker and --legacy'
        )
    return best, seen


def _fitted(
    view: _View, albedo: NDArray, corners: NDArray, before: _Fitted | None, blur: float
) -> _Fitted:
    """Fit each corner's window with the board where `corners` have it."""
    rig, pattern, board = view.rig, view.pattern, view.board
    told = 0 if pattern.axis == 'u' else 1
    known = np.isfinite(corners[:, 0])
    if known.sum() < _PRINT_FIT_FEWEST:
        raise CalibrationError(
            f'fewer than {_PRINT_FIT_FEWEST} corners of the board are seen: light the whole of it'
        )
    _, turn, shift = cv2.solvePnP(
        board.points[known], corners[known], rig.camera.camera_matrix, rig.camera.distortion
    )
    turn, shift = cv2.Rodrigues(turn)[0], np.ravel(shift)
    points = board.points @ turn.T + shift
    middles = rig.camera.project(points)
    # A window's side over the square's, so that no pixel is in two.
    half = max(4, int(0.95 / 2 * board.spacing(middles)))
    first = np.maximum(np.floor(middles.min(axis=0)).astype(int) - half - 2, 0)
    last = np.minimum(
        np.ceil(middles.max(axis=0)).astype(int) + half + 3, [rig.camera.width, rig.camera.height]
    )
    box = slice(first[1], last[1]), slice(first[0], last[0])
    v, u = np.mgrid[box]
    rays = rig.camera.rays(np.stack([u, v], axis=-1).reshape(-1, 2).astype(float))
    on = rays * ((shift @ turn[:, 2]) / (rays @ turn[:, 2]))[:, None]
    place = ((on - shift) @ turn)[:, :2]
    off = np.zeros(3) if before is None else before.off
    lit_by = rig.projector.project(rig.to_projector(on))
    column = (lit_by[:, told] + _plane(board, place) @ off).reshape(u.shape)
    upright = pattern if told == 0 else pattern.transposed
    phase = pattern.phase(column)
    contrast = upright.contrast(phase) * upright.row_contrast(lit_by[:, 1 - told]).reshape(u.shape)
    at = ((place / board.square + 1.5) * PIXELS - 0.5).astype(np.float32).reshape(*u.shape, 2)
    soft = gaussian_filter(albedo, blur * PIXELS / board.spacing(middles))
    white = cv2.remap(
        soft.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=1.0
    ).astype(float)
    slopes = np.gradient(white)[::-1]
    seen = view.levels[box]
    found = np.full((len(points), 3), np.nan)
    misfit, pixels = 0.0, 0
    for index, (x, y) in enumerate(np.rint(middles).astype(int) - first):
        if min(x, y) < half or x + half >= seen.shape[1] or y + half >= seen.shape[0]:
            continue
        window = slice(y - half, y + half + 1), slice(x - half, x + half + 1)
        inside = (each[window].ravel() for each in (seen, white, phase, contrast, *slopes))
        fit = fit_window(*inside)
        misfit, pixels = misfit + fit.unexplained, pixels + (2 * half + 1) ** 2
        if fit.phase_rad * pattern.period_px / (2 * np.pi) < _WORST_PX:
            found[index, 2] = fit.phase
        if fit.shift_px < _WORST_PX and np.hypot(*fit.shift) < half:
            found[index, :2] = fit.shift
    behind = found[:, 2]
    lit = np.isfinite(behind)
    if lit.sum() < _PRINT_FIT_FEWEST:
        raise CalibrationError('the fringes are not seen on the board: light the whole of it')
    mean = np.angle(np.nanmean(np.exp(1j * behind)))
    behind = mean + np.angle(np.exp(1j * (behind - mean)))
    terms = _plane(board, board.points[:, :2])
    along = rig.projector.project(rig.to_projector(points))[:, told] + terms @ off
    columns = along - behind * pattern.period_px / (2 * np.pi)
    more, *_ = np.linalg.lstsq(terms[lit], (columns - along)[lit], rcond=None)
    column = column + (_plane(board, place) @ more).reshape(u.shape)
    return _Fitted(
        middles + found[:, :2], points, columns, off + more, misfit / pixels, box, column, white
    )


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
    corners, lit = seen.corners, np.isfinite(seen.columns)
    points, columns, place = seen.points[lit], seen.columns[lit], board.points[lit]
    rays = points / points[:, 2:]
    known = np.isfinite(corners[:, 0])
    middle = board.points[-1] / 2
    size = float(np.hypot(*middle[:2]))

    def bent(at: NDArray, bend: NDArray) -> NDArray[np.float64]:
        x, y = ((at[:, :2] - middle[:2]) / size).T
        return bend[0] * x * x + bend[1] * x * y + bend[2] * y * y

    def state_of(state: NDArray) -> tuple[Rotation, NDArray, float, NDArray]:
        return Rotation.from_rotvec(state[3:6]), state[6:9], state[9], state[10:]

    def misfit(state: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        turn, shift, scale, bend = state_of(state)
        flat = board.points[known] * scale
        flat[:, 2] = bent(board.points[known], bend)
        off = rig.camera.project(turn.apply(flat) + shift) - corners[known]
        normal = turn.apply([0.0, 0.0, 1.0])
        depth = (shift @ normal + bent(place, bend)) / (rays @ normal)
        by = turned(rig, state[:3])
        pixel = by.projector.project(by.to_projector(depth[:, None] * rays))[:, told]
        # Warmth and damp make a print so much larger or smaller: aluminium by 12, paper by 30
        # kelvin.
        prior = [*state[:3] / ANY_TURN, (scale - 1) / 3e-4, *bend / flatness]
        return off.ravel(), pixel - columns, np.array(prior)

    def residuals(state: NDArray) -> NDArray[np.float64]:
        off, across, prior = misfit(state)
        return np.concatenate([(off.reshape(-1, 2) / corner_px).ravel(), across / phase_px, prior])

    _, turn, shift = cv2.solvePnP(
        board.points[known],
        corners[known],
        rig.camera.camera_matrix,
        rig.camera.distortion,
    )
    start = np.concatenate([np.zeros(3), np.ravel(turn), np.ravel(shift), [1.0], np.zeros(3)])
    corner_px, phase_px = np.full(2, _CORNER_FIRST), PHASE_PX
    for _ in range(3):
        found = least_squares(residuals, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
        off, across, _ = misfit(found.x)
        grid = np.full((board.rows, board.columns, 2), np.nan)
        grid.reshape(-1, 2)[known] = off.reshape(-1, 2)
        # A lens that has changed moves most corners, a shadow or the frame's rim a few.
        near = np.sort(np.linalg.norm(off.reshape(-1, 2), axis=1))
        # The nearest of the corners that tell of the lens, and their part in the mean square of
        # normally distributed vectors in the plane: 1 - q exp(-q) / (1 - exp(-q)), with q = ln 5.
        near = near[: max(1, int(0.8 * len(near)))]
        camera_px = float(np.sqrt(np.mean(near**2) / 0.598))
        corner_px = np.array([_corner_noise(grid[..., axis]) for axis in (0, 1)])
        start, phase_px = found.x, scatter(across, PHASE_LEAST)
    covariance = turn_covariance(found.jac)
    result = judged(rig, pattern, found.x[:3], covariance, np.median(points, axis=0))
    return replace(result, camera_px=camera_px)


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
