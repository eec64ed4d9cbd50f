"""Where the bundle adjustment starts from, and gross mistakes that show already there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.bundle import Adjustment
from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.rig.rig import Lens, Rig

# Fewer views of a plane leave a camera's focal lengths and principal point open.
FEWEST_POSES = 3
_FEWEST_CORNERS = 8
# Without a third coefficient and tangential terms the start is safe; the adjustment adds them.
_SAFE = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


def first_rig(
    observations: list[Observation],
    board: NDArray[np.float64],
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
) -> Adjustment:
    """A rig and the board's poses, good enough to adjust.

    The camera by Zhang's method. The corners are known in three dimensions then, and the projector
    is one view of all of them, so that its principal point may lie anywhere.

    Raises
    ------
    CalibrationError
        Too few poses, a mirrored board, exchanged or mirrored projector coordinates.
    """
    useful = [o for o in observations if np.isfinite(o.camera[:, 0]).sum() >= _FEWEST_CORNERS]
    lit = [o for o in useful if o.has_projector]
    if len(useful) < FEWEST_POSES or len(lit) < FEWEST_POSES:
        raise CalibrationError(
            f'{len(useful)} poses show the board and {len(lit)} of them the projected codes, '
            f'fewer than {FEWEST_POSES}: photograph more poses'
        )
    _refuse_mirrors(useful, board)
    seen = [np.isfinite(o.camera[:, 0]) for o in observations]
    camera, turns, shifts = _calibrated(
        [board[s] for s in seen],
        [o.camera[s] for o, s in zip(observations, seen, strict=True)],
        camera_size,
    )
    poses = np.hstack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))]).astype(float)
    start = Adjustment(
        observations, board, Rig(camera, camera, np.eye(3), np.zeros(3)), poses, np.zeros(3)
    )
    points = start.points().reshape(-1, 3)
    pixels = np.concatenate([o.projector for o in observations])
    known = np.isfinite(pixels).all(axis=1)
    if known.sum() < FEWEST_POSES * _FEWEST_CORNERS:
        raise CalibrationError(
            f'both projector coordinates of {known.sum()} corners are known, fewer than '
            f'{FEWEST_POSES * _FEWEST_CORNERS}: the photographs of rows or columns are missing'
        )
    projector, turn, shift = _calibrated([points[known]], [pixels[known]], projector_size)
    rig = Rig(camera, projector, np.asarray(cv2.Rodrigues(turn[0])[0]), np.ravel(shift[0]))
    return replace(start, rig=rig)


def _calibrated(
    points: list[NDArray], pixels: list[NDArray], size: tuple[int, int]
) -> tuple[Lens, Any, Any]:
    """A lens, and the rotation vector and the translation of each view."""
    guess, flags = np.eye(3), _SAFE
    if len(points) == 1:
        width, height = size
        guess = np.array([[1.5 * width, 0, width / 2], [0, 1.5 * width, height / 2], [0, 0, 1]])
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    threads = cv2.getNumThreads()
    # Threads add up in any order: the same photographs are to give the same rig, and its id.
    cv2.setNumThreads(1)
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [each.astype(np.float32) for each in points],
            [each.astype(np.float32) for each in pixels],
            size,
            guess,
            np.zeros(5),
            flags=flags,
        )
    finally:
        cv2.setNumThreads(threads)
    lens = Lens(*size, np.asarray(matrix), np.ravel(distortion)[:5].astype(float))
    return lens, turns, shifts


def _refuse_mirrors(observations: list[Observation], board: NDArray) -> None:
    """Raise `CalibrationError` where the sense of rotation is reversed, as in a mirror."""
    flipped = [o.name for o in observations if np.linalg.det(_linear(board, o.camera)) < 0]
    if flipped:
        more = f' and {len(flipped) - 3} more' if len(flipped) > 3 else ''
        raise CalibrationError(
            f'{", ".join(flipped[:3])}{more}: the corners run as in a mirror: the board is '
            'described mirrored, the photographs are flipped, or x and y of the corners are '
            'exchanged'
        )
    both = [o for o in observations if np.isfinite(o.camera + o.projector).all(axis=1).sum() > 2]
    lit = np.sum([np.zeros((2, 2)), *(_linear(o.camera, o.projector) for o in both)], axis=0)
    if np.linalg.det(lit) >= 0:
        return
    # Rows and columns exchanged are a mirror and a quarter turn; nobody mounts a projector so.
    exchanged = np.linalg.norm(lit[[0, 1], [1, 0]]) > np.linalg.norm(np.diag(lit))
    raise CalibrationError(
        "the projector's rows and columns are exchanged: give the photographs of the columns "
        'first, or exchange its width and height'
        if exchanged
        else "the projector's image is mirrored: switch its rear projection or ceiling mode off, "
        "and the flipping of photographs in the camera's driver, or see that width and height are "
        'the right way round'
    )


def _linear(start: NDArray, end: NDArray) -> NDArray[np.float64]:
    """The linear part, shape (2, 2), of the map from places (n, 2 or more) to places (n, 2)."""
    known = np.isfinite(start).all(axis=1) & np.isfinite(end).all(axis=1)
    start, end = start[known, :2], end[known]
    linear, *_ = np.linalg.lstsq(start - start.mean(axis=0), end - end.mean(axis=0), rcond=None)
    return linear
