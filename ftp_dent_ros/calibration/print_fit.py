"""A ChArUco board under fringes: its print, which is known, and their light fitted together.

The markers leave no window wide enough for corners alone, and hide the stripe from whoever knows
of no print. But the print is known, and where the board is nearly: about each corner the light's
strength and phase and the corner's place are estimated at once, and the stripe's colour, looked up
where the print is white, tells of which fringe the phase is.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.board_light import smoothed
from ftp_dent_ros.calibration.checking import fringe_levels
from ftp_dent_ros.errors import CalibrationError, ConfigurationError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.photograph import Photograph
from ftp_dent_ros.rig import Rig

_PIXELS = 32  # of the print, a square
# Blur of the edges at first, wide, for corners are known to a few camera pixels then; those that
# are tried afterwards, of which the photograph chooses.
_FIRST_BLUR = 2.0
_BLURS = 0.5, 0.8, 1.2, 1.7
# A window's side over the square's, so that no pixel is in two.
_WINDOW = 0.95
# Corners and columns known worse than this tell nothing; camera and projector pixels.
_WORST_PX = 0.5
# Pixels are of one colour where the print is so white, and lit where the light is so strong (of
# its mean); a fringe's colour is the mean of so many of them at least.
_WHITE, _LIT, _FEWEST = 0.9, 1.2, 30
# Terms of a window's light: on white its mean, fringes and their second harmonic; on ink, which
# reflects a little, its mean and fringes.
_ON_WHITE, _ON_INK = 5, 3


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


def fit_print(rig: Rig, pattern: Pattern, board: Board, image: Photograph | NDArray) -> PrintFit:
    """Corners of a ChArUco board in the flight's pattern, and the projector's columns there.

    Raises
    ------
    CalibrationError
        The board is not seen whole, its markers are others, or no stripe is on it.
    ConfigurationError
        The pattern has no stripe.
    """
    if pattern.code != 'stripe':
        raise ConfigurationError(
            f'a ChArUco board is seen under a pattern with a stripe, and this has code: '
            f'{pattern.code}: use a chessboard, or project the pattern with a stripe'
        )
    levels = fringe_levels(image, rig)
    plain = replace(board, dictionary='', marker=0.0, legacy=False)
    try:
        rough = plain.find_rough(smoothed(levels, rig, pattern))
    except CalibrationError:
        raise CalibrationError(
            f'no ChArUco board of {board.columns}x{board.rows} inner corners is seen whole under '
            'the fringes: check the numbers, the light and that no corner is hidden'
        ) from None
    size = (board.columns + 2) * _PIXELS, (board.rows + 2) * _PIXELS
    large = board.draw(board.exact_pixels(_PIXELS))
    drawn = cv2.resize(large, size, interpolation=cv2.INTER_AREA) / 255.0
    # It may be seen from either end, and its markers tell which it is.
    tries = []
    prints = [drawn, _unmarked(board, drawn)] if board.dictionary else [drawn]
    for corners in (rough, rough[::-1].copy()):
        for albedo in prints:
            with suppress(CalibrationError):
                found = _fitted(rig, pattern, board, levels, albedo, corners, None, _FIRST_BLUR)
                tries.append((found.misfit, albedo is drawn, found))
    if not tries:
        raise CalibrationError('the fringes are not seen on the board: light the whole of it')
    _, is_its, seen = min(tries, key=lambda each: each[0])
    if not is_its:
        raise CalibrationError(
            f'the squares of a board of {board.columns}x{board.rows} inner corners are seen, but '
            f'not the markers of {board.dictionary} with a side of {1e3 * board.marker:g} mm: '
            'check --charuco, --marker and --legacy'
        )
    seen = _fitted(rig, pattern, board, levels, drawn, seen.corners, seen, _BLURS[1])
    sharp = [
        _fitted(rig, pattern, board, levels, drawn, seen.corners, seen, blur) for blur in _BLURS
    ]
    seen = min(sharp, key=lambda each: each.misfit)
    shift = _fringes_off(pattern, seen, image, rig)
    return PrintFit(seen.corners, seen.points, seen.columns - shift * pattern.period_px)


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


def _fitted(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    levels: NDArray,
    drawn: NDArray,
    corners: NDArray,
    before: _Fitted | None,
    blur: float,
) -> _Fitted:
    """Fit each corner's window with the board where `corners` have it."""
    told = 0 if pattern.axis == 'u' else 1
    known = np.isfinite(corners[:, 0])
    if known.sum() < 6:
        raise CalibrationError('fewer than 6 corners of the board are seen: light the whole of it')
    _, turn, shift = cv2.solvePnP(
        board.points[known], corners[known], rig.camera.camera_matrix, rig.camera.distortion
    )
    turn, shift = cv2.Rodrigues(turn)[0], np.ravel(shift)
    points = board.points @ turn.T + shift
    middles = rig.camera.project(points)
    half = max(4, int(_WINDOW / 2 * board.spacing(middles)))
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
    column = rig.projector.project(rig.to_projector(on))[:, told] + _plane(board, place) @ off
    at = ((place / board.square + 1.5) * _PIXELS - 0.5).astype(np.float32).reshape(*u.shape, 2)
    soft = gaussian_filter(drawn, blur * _PIXELS / board.spacing(middles))
    albedo = cv2.remap(
        soft.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=1.0
    ).astype(float)
    column = column.reshape(u.shape)
    phase = pattern.phase(column)
    slopes = np.gradient(albedo)[::-1]
    seen = levels[box]
    found = np.full((len(points), 3), np.nan)
    misfit, pixels = 0.0, 0
    for index, (x, y) in enumerate(np.rint(middles).astype(int) - first):
        if min(x, y) < half or x + half >= seen.shape[1] or y + half >= seen.shape[0]:
            continue
        window = slice(y - half, y + half + 1), slice(x - half, x + half + 1)
        light, variance, square = _window(
            seen[window].ravel(),
            albedo[window].ravel(),
            phase[window].ravel(),
            [slope[window].ravel() for slope in slopes],
        )
        misfit, pixels = misfit + square, pixels + (2 * half + 1) ** 2
        strength = np.hypot(light[1], light[2])
        worst = np.sqrt(max(variance[1], variance[2])) / max(strength, 1e-9)
        if worst * pattern.period_px / (2 * np.pi) < _WORST_PX:
            found[index, 2] = np.arctan2(light[2], light[1])
        if np.sqrt(variance[-2:].max()) < _WORST_PX and np.hypot(*light[-2:]) < half:
            found[index, :2] = light[-2:]
    behind = found[:, 2]
    lit = np.isfinite(behind)
    if lit.sum() < 6:
        raise CalibrationError('the fringes are not seen on the board: light the whole of it')
    mean = np.angle(np.nanmean(np.exp(1j * behind)))
    behind = mean + np.angle(np.exp(1j * (behind - mean)))
    terms = _plane(board, board.points[:, :2])
    along = rig.projector.project(rig.to_projector(points))[:, told] + terms @ off
    columns = along - behind * pattern.period_px / (2 * np.pi)
    more, *_ = np.linalg.lstsq(terms[lit], (columns - along)[lit], rcond=None)
    column = column + (_plane(board, place) @ more).reshape(u.shape)
    return _Fitted(
        middles + found[:, :2], points, columns, off + more, misfit / pixels, box, column, albedo
    )


def _window(
    seen: NDArray, albedo: NDArray, phase: NDArray, slopes: list[NDArray]
) -> tuple[NDArray, NDArray, float]:
    """Light and shift of one window: numbers, their variances and the squares not explained."""
    waves = np.column_stack(
        [np.ones_like(phase), *(f(n * phase) for n in (1, 2) for f in (np.cos, np.sin))]
    )
    on_ink = waves[:, :_ON_INK]
    still = np.column_stack([albedo[:, None] * waves, (1 - albedo)[:, None] * on_ink])
    numbers, *_ = np.linalg.lstsq(still, seen, rcond=None)
    for _ in range(2):
        contrast = waves @ numbers[:_ON_WHITE] - on_ink @ numbers[_ON_WHITE : _ON_WHITE + _ON_INK]
        terms = np.column_stack([still, *(-contrast * slope for slope in slopes)])
        numbers, *_ = np.linalg.lstsq(terms, seen, rcond=None)
    left = float(np.square(seen - terms @ numbers).sum())
    inverse = np.linalg.pinv(terms.T @ terms)
    return numbers, np.diag(inverse) * left / max(1, len(seen) - terms.shape[1]), left


def _plane(board: Board, place: NDArray) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(place)), place / board.points[-1, :2] - 0.5])


def _unmarked(board: Board, drawn: NDArray) -> NDArray[np.float64]:
    """The print with each marker's ink spread within its border, which all dictionaries share."""
    plain = drawn.copy()
    margin = (1 - board.marker / board.square) / 2 + board.module / board.square
    inner = round(_PIXELS * margin)
    half = _PIXELS // 2
    for row in range(half, drawn.shape[0] - half, _PIXELS):
        for column in range(half, drawn.shape[1] - half, _PIXELS):
            if drawn[row, column] > 0.5:
                marker = plain[
                    row + inner : row + _PIXELS - inner, column + inner : column + _PIXELS - inner
                ]
                marker[:] = marker.mean()
    return plain


def _fringes_off(pattern: Pattern, seen: _Fitted, image: Photograph | NDArray, rig: Rig) -> int:
    """By how many periods the columns are too large: the red fringe is the stripe."""
    photograph = Photograph.of(image)
    if rig.response is not None:
        photograph = photograph.linear(rig.response)
    red, green, _ = np.moveaxis(photograph.rgb()[seen.box].astype(float), -1, 0)
    light = 2 * np.cos(pattern.phase(seen.column))
    bright = (seen.albedo > _WHITE) & (light > _LIT)
    order = np.rint(pattern.phase(seen.column[bright]) / (2 * np.pi)).astype(int)
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
