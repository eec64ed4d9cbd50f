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
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.checking import (
    ALIKE,
    MOST_POINTS,
    PHASE_PX,
    Check,
    fringe_levels,
    judged,
    turn_covariance,
    turned,
)
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.photograph import Photograph
from ftp_dent_ros.rig import Rig

# Least points on the board, and corners.
_FEWEST_POINTS, _FEWEST_CORNERS = 200, 12
# Corners through fringes are known to this at best; pixels, standard deviation.
_CORNER_PX = 0.05
# Warmth and damp make a print so much larger or smaller: aluminium by 12, paper by 30 kelvin.
_SCALE = 3e-4
# A corner in smoothed light is off by half a fringe at most, pixels of a usual rig.
_ROUGH_PX = 6.0
# Of the polynomial that projector columns are over the board, and how far beyond its corners it is
# believed, as a part of its sides.
_DEGREE, _AROUND = 4, 0.2
# Part of a square's side within which it is of one colour in spite of blur, and samples a side.
_INNER, _SAMPLES = 0.6, 13
_ROUNDS = 2
# The nearest of the corners that tell of the lens, and their part in the mean square of normally
# distributed vectors in the plane: 1 - q exp(-q) / (1 - exp(-q)), with q = ln 5.
_KEPT, _OF_KEPT = 0.8, 0.598


def check_by_board(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    image: Photograph | NDArray,
    points: NDArray,
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
    points : ndarray, shape (rows, columns, 3)
        The cloud that was computed of it with `rig`, metres; NaN where there is none.
    flatness : float
        How far the board's border may lie off the plane of its middle, metres, standard
        deviation.

    Raises
    ------
    CalibrationError
        The board is not seen, or too little of it was measured.
    """
    told = 0 if pattern.axis == 'u' else 1
    levels = fringe_levels(image)
    rough = _rough_corners(board, _smoothed(levels, rig, pattern))
    seen = points[np.isfinite(points).all(axis=-1)].astype(float)
    to_board, _ = cv2.findHomography(rough, board.points[:, :2])
    place = _mapped(to_board, rig.camera.project(seen))
    on = ((place > 0) & (place < board.points[-1, :2])).all(axis=1)
    if on.sum() < _FEWEST_POINTS:
        raise CalibrationError(
            f'{on.sum()} points of the board were measured, fewer than {_FEWEST_POINTS}: bring '
            'it nearer, and the whole of it into the light'
        )
    seen, place = seen[on], place[on]
    columns = rig.projector.project(rig.to_projector(seen))[:, told]
    fitted, inside = _smooth_columns(place / board.points[-1, :2], columns)
    light = _light(board, pattern, levels, to_board, fitted)
    corners = rough
    for _ in range(_ROUNDS):
        corners, _ = board.refine(levels, corners, light)
        lost = np.isnan(corners[:, 0])
        if (~lost).sum() < _FEWEST_CORNERS:
            raise CalibrationError(
                f'{(~lost).sum()} corners of the board are seen, fewer than {_FEWEST_CORNERS}: '
                'see that board, light and focus are right'
            )
    every = max(1, int(inside.sum()) // MOST_POINTS)
    seen, columns, place = seen[inside][::every], columns[inside][::every], place[inside][::every]
    return _fit(rig, pattern, board, corners, seen, columns, place, flatness)


def _fit(
    rig: Rig,
    pattern: Pattern,
    board: Board,
    corners: NDArray,
    seen: NDArray,
    columns: NDArray,
    place: NDArray,
    flatness: float,
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

    def residuals(state: NDArray) -> NDArray[np.float64]:
        turn, shift, scale, bend = state_of(state)
        flat = board.points[known] * scale
        flat[:, 2] = bent(board.points[known], bend)
        off = rig.camera.project(turn.apply(flat) + shift) - corners[known]
        normal = turn.apply([0.0, 0.0, 1.0])
        depth = (shift @ normal + bent(place, bend)) / (rays @ normal)
        by = turned(rig, state[:3])
        pixel = by.projector.project(by.to_projector(depth[:, None] * rays))[:, told]
        return np.concatenate(
            [
                off.ravel() / _CORNER_PX,
                (pixel - columns) / (PHASE_PX * ALIKE),
                [(scale - 1) / _SCALE],
                bend / flatness,
            ]
        )

    _, turn, shift = cv2.solvePnP(
        board.points[known],
        corners[known],
        rig.camera.camera_matrix,
        rig.camera.distortion,
    )
    start = np.concatenate([np.zeros(3), np.ravel(turn), np.ravel(shift), [1.0], np.zeros(3)])
    found = least_squares(residuals, start, x_scale='jac', loss='soft_l1', f_scale=2.0)
    off = np.linalg.norm(found.fun[: 2 * int(known.sum())].reshape(-1, 2), axis=1)
    # What does not fit as it should is less sure by as much.
    worse = max(1.0, float(np.sqrt(np.mean(off**2) / 2)))
    # A lens that has changed moves most corners, a shadow or the frame's rim a few.
    near = np.sort(off)[: max(1, int(_KEPT * len(off)))]
    camera_px = _CORNER_PX * float(np.sqrt(np.mean(near**2) / _OF_KEPT))
    covariance = turn_covariance(found.jac) * worse**2
    result = judged(rig, pattern, found.x[:3], covariance, np.median(seen, axis=0))
    return replace(result, camera_px=camera_px)


def _rough_corners(board: Board, photograph: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Corners to a few pixels, all of them, where each lies as the whole board's plane has it."""
    found = board.find(photograph)
    known = np.isfinite(found[:, 0])
    plane, _ = cv2.findHomography(board.points[known, :2], found[known], cv2.RANSAC, _ROUGH_PX)
    if plane is None:
        raise CalibrationError('the corners found lie on no plane: show the board alone')
    return _mapped(plane, board.points[:, :2])


def _smoothed(levels: NDArray, rig: Rig, pattern: Pattern) -> NDArray[np.uint8]:
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


def _smooth_columns(place: NDArray, columns: NDArray) -> tuple[NDArray, NDArray[np.bool_]]:
    """Coefficients of the columns over the board's unit square, and which points fit them."""
    terms = _terms(place)
    inside = np.ones(len(place), bool)
    for _ in range(3):
        fitted, *_ = np.linalg.lstsq(terms[inside], columns[inside], rcond=None)
        off = np.abs(columns - terms @ fitted)
        inside = off <= 4 * 1.4826 * np.median(off) + 1e-6
    return fitted, inside


def _terms(place: NDArray) -> NDArray[np.float64]:
    x, y = place.T
    return np.polynomial.polynomial.polyvander2d(x, y, [_DEGREE, _DEGREE])


def _light(
    board: Board, pattern: Pattern, levels: NDArray, to_board: NDArray, fitted: NDArray
) -> NDArray[np.float32]:
    """Light of the fringes on each pixel of the board, mean 1; 1 elsewhere."""
    v, u = np.indices(levels.shape)
    place = _mapped(to_board, np.stack([u.ravel(), v.ravel()], axis=1)) / board.points[-1, :2]
    on = ((place > -_AROUND) & (place < 1 + _AROUND)).all(axis=1)
    wave = np.zeros(levels.size, np.float32)
    wave[on] = 2 * pattern.intensity(_terms(place[on]) @ fitted) - 1
    image: NDArray[np.float32] = wave.reshape(levels.shape)
    contrast = _contrast(board, levels, image, np.linalg.inv(to_board))
    return 1 + np.float32(contrast) * image


def _contrast(board: Board, levels: NDArray, wave: NDArray, to_image: NDArray) -> float:
    """Contrast of the fringes on the board's white squares, 0 to 1."""
    offsets = np.linspace(-_INNER / 2, _INNER / 2, _SAMPLES)
    x, y, dx, dy = np.meshgrid(
        np.arange(board.columns - 1) + 0.5, np.arange(board.rows - 1) + 0.5, offsets, offsets
    )
    at = _mapped(to_image, board.square * np.stack([(x + dx).ravel(), (y + dy).ravel()], axis=1))
    seen, lit = (
        map_coordinates(each, at[:, ::-1].T, order=1, mode='nearest').reshape(-1, _SAMPLES**2)
        for each in (levels, wave)
    )
    means = seen.mean(axis=1)
    bright = means >= np.median(means)
    slopes, middles = np.array(
        [np.polyfit(*each, 1) for each in zip(lit[bright], seen[bright], strict=True)]
    ).T
    return float(np.clip(np.median(slopes / np.maximum(middles, 1e-3)), 0, 1))


def _mapped(plane: NDArray, at: NDArray) -> NDArray[np.float64]:
    """Points of shape (n, 2) through a homography."""
    ends = np.asarray(at, float) @ plane[:, :2].T + plane[:, 2]
    return ends[:, :2] / ends[:, 2:]
