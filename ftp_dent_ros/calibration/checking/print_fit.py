"""A board under fringes: its print, which is known, and their light fitted together.

Dark squares and markers leave no window wide enough for corners alone, and hide the fringes' order
from whoever knows of no print. But the print is known, and where the board is nearly: about each
corner the light's strength and phase and the corner's place are estimated at once. Of which fringe
the phase is, tell the stripe's colour or the fringes' contrast where the print is white.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ftp_dent_ros.calibration.boards.board import Board
from ftp_dent_ros.calibration.checking.board_light import contrast_order, smoothed, stripe_order
from ftp_dent_ros.calibration.checking.board_print import (
    PIXELS,
    albedo_of,
    negative,
    without_markers,
)
from ftp_dent_ros.calibration.checking.print_window import fit_window
from ftp_dent_ros.calibration.checking.wall_check import fringe_levels, linear_photograph
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

# Blur of the edges at first, wide, for corners are known to a few camera pixels then; those that
# are tried afterwards, of which the photograph chooses.
_FIRST_BLUR = 2.0
_BLURS = 0.5, 0.8, 1.2, 1.7
# A window's side over the square's, so that no pixel is in two.
_WINDOW = 0.95
# Corners and columns known worse than this tell nothing; camera and projector pixels.
_WORST_PX = 0.5
# Fewer corners, or windows in which fringes are seen, tell not how a board lies.
_FEWEST = 6


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
    if known.sum() < _FEWEST:
        raise CalibrationError(
            f'fewer than {_FEWEST} corners of the board are seen: light the whole of it'
        )
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
    if lit.sum() < _FEWEST:
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
