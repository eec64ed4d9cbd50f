"""Whether a rig still holds, from one photograph of a calibration board in the flight's pattern.

The camera tells from the board's corners where the board is, and so which projector column must
light each of its points; the fringes tell which one does.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.boards.board import Board
from ftp_dent_ros.calibration.checking.print_fit import fit_print
from ftp_dent_ros.calibration.checking.verdict import Check, judged, turn_covariance, turned
from ftp_dent_ros.calibration.checking.wall_check import ANY_TURN, PHASE_LEAST, PHASE_PX, scatter
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.rig.rig import Rig

# Corners through fringes are known to this at first and at best; pixels, standard deviation.
_CORNER_FIRST, _CORNER_LEAST = 0.05, 0.01
# Warmth and damp make a print so much larger or smaller: aluminium by 12, paper by 30 kelvin.
_SCALE = 3e-4
# Neighbouring corners that err more alike than this are one; their correlation.
_MOST_ALIKE = 0.8
_ROUNDS = 3
# The nearest of the corners that tell of the lens, and their part in the mean square of normally
# distributed vectors in the plane: 1 - q exp(-q) / (1 - exp(-q)), with q = ln 5.
_KEPT, _OF_KEPT = 0.8, 0.598


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
        prior = [*state[:3] / ANY_TURN, (scale - 1) / _SCALE, *bend / flatness]
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
    for _ in range(_ROUNDS):
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
        ratio = np.clip(ratio, 0, _MOST_ALIKE)
        factor *= (1 + ratio) / (1 - ratio)
    return float(np.sqrt(np.nanmean(off**2) * factor))
