"""Whether a rig still holds, from one photograph of a calibration board in the flight's pattern.

The camera tells from the board's corners where the board is, and so which projector column must
light each of its points; the fringes tell which one does. The corners are seen through the
fringes: their light is modelled where the edges are fitted.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.board_light import light, mapped, smooth_columns, smoothed
from ftp_dent_ros.calibration.checking import (
    ALIKE,
    MOST_POINTS,
    PHASE_LEAST,
    PHASE_PX,
    fringe_levels,
    scatter,
)
from ftp_dent_ros.calibration.print_fit import fit_print
from ftp_dent_ros.calibration.verdict import Check, judged, turn_covariance, turned
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.photograph import Photograph
from ftp_dent_ros.rig import Rig

# Least points on the board, and corners.
_FEWEST_POINTS, _FEWEST_CORNERS = 200, 12
# Corners through fringes are known to this at first and at best; pixels, standard deviation.
_CORNER_FIRST, _CORNER_LEAST = 0.05, 0.01
# Warmth and damp make a print so much larger or smaller: aluminium by 12, paper by 30 kelvin.
_SCALE = 3e-4
# A corner in smoothed light is off by half a fringe at most, pixels of a usual rig.
_ROUGH_PX = 6.0
# Neighbouring corners that err more alike than this are one; their correlation.
_MOST_ALIKE = 0.8
_ROUNDS, _ROUNDS_OF_NOISE = 2, 3
# The nearest of the corners that tell of the lens, and their part in the mean square of normally
# distributed vectors in the plane: 1 - q exp(-q) / (1 - exp(-q)), with q = ln 5.
_KEPT, _OF_KEPT = 0.8, 0.598


def check_by_board(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    image: Photograph | NDArray,
    points: NDArray | None = None,
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
    points : ndarray, shape (rows, columns, 3), optional
        The cloud that was computed of it with `rig`, metres; NaN where there is none. A ChArUco
        board needs none.
    flatness : float
        How far the board's border may lie off the plane of its middle, metres, standard
        deviation.

    Raises
    ------
    CalibrationError
        The board is not seen, or too little of it was measured.
    """
    if board.dictionary:
        return _check_by_print(rig, pattern, board, image, flatness)
    if points is None:
        raise ValueError('points are needed for a chessboard')
    told = 0 if pattern.axis == 'u' else 1
    levels = fringe_levels(image, rig)
    rough = _rough_corners(board, smoothed(levels, rig, pattern))
    seen = points[np.isfinite(points).all(axis=-1)].astype(float)
    to_board, _ = cv2.findHomography(rough, board.points[:, :2])
    place = mapped(to_board, rig.camera.project(seen))
    on = ((place > 0) & (place < board.points[-1, :2])).all(axis=1)
    if on.sum() < _FEWEST_POINTS:
        raise CalibrationError(
            f'{on.sum()} points of the board were measured, fewer than {_FEWEST_POINTS}: bring '
            'it nearer, and the whole of it into the light'
        )
    seen, place = seen[on], place[on]
    columns = rig.projector.project(rig.to_projector(seen))[:, told]
    fitted, inside = smooth_columns(place / board.points[-1, :2], columns)
    wave = light(board, pattern, levels, to_board, fitted)
    corners = rough
    for _ in range(_ROUNDS):
        corners, _ = board.refine(levels, corners, wave)
        lost = np.isnan(corners[:, 0])
        if (~lost).sum() < _FEWEST_CORNERS:
            raise CalibrationError(
                f'{(~lost).sum()} corners of the board are seen, fewer than {_FEWEST_CORNERS}: '
                'see that board, light and focus are right'
            )
    every = max(1, int(inside.sum()) // MOST_POINTS)
    seen, columns, place = seen[inside][::every], columns[inside][::every], place[inside][::every]
    return _fit(rig, pattern, board, corners, seen, columns, place, flatness)


def _check_by_print(
    rig: Rig, pattern: Pattern, board: Board, image: Photograph | NDArray, flatness: float
) -> Check:
    found = fit_print(rig, pattern, board, image)
    lit = np.isfinite(found.columns)
    return _fit(
        rig,
        pattern,
        board,
        found.corners,
        found.points[lit],
        found.columns[lit],
        board.points[lit],
        flatness,
        alike=1.0,
    )


def _fit(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    corners: NDArray,
    seen: NDArray,
    columns: NDArray,
    place: NDArray,
    flatness: float,
    alike: float = ALIKE,
) -> Check:
    """The projector's turn, with the board's pose, size and bend as unknowns."""
    told = 0 if pattern.axis == 'u' else 1
    rays = seen / seen[:, 2:]
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
        return off.ravel(), pixel - columns, np.append((scale - 1) / _SCALE, bend / flatness)

    def residuals(state: NDArray) -> NDArray[np.float64]:
        off, across, prior = misfit(state)
        return np.concatenate(
            [(off.reshape(-1, 2) / corner_px).ravel(), across / (phase_px * alike), prior]
        )

    _, turn, shift = cv2.solvePnP(
        board.points[known],
        corners[known],
        rig.camera.camera_matrix,
        rig.camera.distortion,
    )
    start = np.concatenate([np.zeros(3), np.ravel(turn), np.ravel(shift), [1.0], np.zeros(3)])
    corner_px, phase_px = np.full(2, _CORNER_FIRST), PHASE_PX
    for _ in range(_ROUNDS_OF_NOISE):
        found = least_squares(residuals, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
        off, across, _ = misfit(found.x)
        grid = np.full((board.rows, board.columns, 2), np.nan)
        grid.reshape(-1, 2)[known] = off.reshape(-1, 2)
        # A lens that has changed moves most corners, a shadow or the frame's rim a few.
        near = np.sort(np.linalg.norm(off.reshape(-1, 2), axis=1))
        near = near[: max(1, int(_KEPT * len(near)))]
        camera_px = float(np.sqrt(np.mean(near**2) / _OF_KEPT))
        corner_px = np.array([_corner_noise(grid[..., axis]) for axis in (0, 1)])
        start, phase_px = found.x, scatter(across, PHASE_LEAST)
    covariance = turn_covariance(found.jac)
    result = judged(rig, pattern, found.x[:3], covariance, np.median(seen, axis=0))
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
        ratio = np.clip(ratio, 0, _MOST_ALIKE)
        factor *= (1 + ratio) / (1 - ratio)
    return float(np.sqrt(np.nanmean(off**2) * factor))


def _rough_corners(board: Board, photograph: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Corners to a few pixels, all of them, where each lies as the whole board's plane has it."""
    found = board.find(photograph)
    known = np.isfinite(found[:, 0])
    plane, _ = cv2.findHomography(board.points[known, :2], found[known], cv2.RANSAC, _ROUGH_PX)
    if plane is None:
        raise CalibrationError('the corners found lie on no plane: show the board alone')
    return mapped(plane, board.points[:, :2])
