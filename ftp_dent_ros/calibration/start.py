"""Where the bundle adjustment starts from, and gross mistakes that show already there."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.rig.rig import Lens, Rig

# Fewer views of a plane leave a camera's focal lengths and principal point open.
FEWEST_POSES = 3
_FEWEST_CORNERS = 8
# Without a third coefficient and tangential terms the start is safe; the adjustment adds them.
_SAFE = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


def refuse_mirrored_board(observations: list[Observation], board: NDArray) -> None:
    """Raise `CalibrationError` if the corners run the wrong way round."""
    mirrored = [o.name for o in observations if _turns_over(board[:, :2], o.camera)]
    if mirrored:
        raise CalibrationError(
            f'{_listed(mirrored)}: the corners run as in a mirror: the board is described '
            'mirrored, the photographs are flipped, or x and y of the corners are exchanged'
        )


def first_rig(
    observations: list[Observation],
    board: NDArray[np.float64],
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
) -> tuple[Rig, NDArray[np.float64]]:
    """A rig and the board's poses, shape (p, 6), good enough to adjust.

    The camera by Zhang's method; the projector by a linear resection of all corners that are
    known in three dimensions then (direct linear transformation), so that its principal point
    may lie anywhere.

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
    refuse_mirrored_board(useful, board)
    seen = [np.isfinite(o.camera[:, 0]) for o in observations]
    threads = cv2.getNumThreads()
    # Threads add up in any order: the same photographs are to give the same rig, and its id.
    cv2.setNumThreads(1)
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            [board[s].astype(np.float32) for s in seen],
            [o.camera[s].astype(np.float32) for o, s in zip(observations, seen, strict=True)],
            camera_size,
            np.eye(3),
            np.zeros(5),
            flags=_SAFE,
        )
    finally:
        cv2.setNumThreads(threads)
    camera = Lens(*camera_size, np.asarray(matrix), np.ravel(distortion)[:5].astype(float))
    poses = np.hstack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))]).astype(float)
    points = np.concatenate(
        [Rotation.from_rotvec(pose[:3]).apply(board) + pose[3:] for pose in poses]
    )
    pixels = np.concatenate([o.projector for o in observations])
    known = np.isfinite(pixels).all(axis=1)
    if known.sum() < 3 * _FEWEST_CORNERS:
        raise CalibrationError(
            f'both projector coordinates of {known.sum()} corners are known, fewer than '
            f'{3 * _FEWEST_CORNERS}: the photographs of rows or columns are missing'
        )
    camera_matrix, rotation, translation, handed = _resection(points[known], pixels[known])
    if handed < 0:
        _refuse_mirrored_projector(points[known], pixels[known], projector_size)
    projector = Lens(*projector_size, camera_matrix, np.zeros(5))
    return Rig(camera, projector, rotation, translation), poses


def _resection(
    points: NDArray, pixels: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Camera matrix, rotation and translation of points and their pixels; handedness last."""
    inside = np.ones(len(points), bool)
    for _ in range(3):
        projection = _direct_linear(points[inside], pixels[inside])
        ends = points @ projection[:, :3].T + projection[:, 3]
        off = np.linalg.norm(ends[:, :2] / ends[:, 2:] - pixels, axis=1)
        inside = off <= 4 * np.median(off) + 1e-9
    handed = float(np.sign(np.mean(ends[:, 2]) * np.linalg.det(projection[:, :3])))
    if np.mean(ends[:, 2]) < 0:
        projection = -projection
    upper, turn = rq(projection[:, :3])
    signs = np.diag(np.sign(np.diag(upper)))
    upper, turn = upper @ signs, signs @ turn
    translation = np.linalg.solve(upper, projection[:, 3])
    upper /= upper[2, 2]
    matrix = np.array([[upper[0, 0], 0, upper[0, 2]], [0, upper[1, 1], upper[1, 2]], [0, 0, 1]])
    return matrix, turn, translation, handed


def _direct_linear(points: NDArray, pixels: NDArray) -> NDArray[np.float64]:
    """Projection matrix of shape (3, 4) by the normalised direct linear transformation."""
    middle, size = points.mean(axis=0), points.std()
    centre, scale = pixels.mean(axis=0), pixels.std()
    world = np.hstack([(points - middle) / size, np.ones((len(points), 1))])
    u, v = ((pixels - centre) / scale).T
    rows = np.zeros((2 * len(points), 12))
    rows[::2, :4], rows[::2, 8:] = world, -u[:, None] * world
    rows[1::2, 4:8], rows[1::2, 8:] = world, -v[:, None] * world
    _, _, vectors = np.linalg.svd(rows.T @ rows)
    projection = vectors[-1].reshape(3, 4)
    to_pixels = np.array([[scale, 0, centre[0]], [0, scale, centre[1]], [0, 0, 1]])
    to_unit = np.hstack([np.eye(3) / size, -middle[:, None] / size])
    projection = to_pixels @ projection @ np.vstack([to_unit, [0, 0, 0, 1]])
    return projection / np.linalg.norm(projection[2, :3])


def _refuse_mirrored_projector(points: NDArray, pixels: NDArray, size: tuple[int, int]) -> None:
    # Rows and columns exchanged are a mirror and a quarter turn; nobody mounts a projector so.
    mirrored = np.column_stack([size[0] - 1 - pixels[:, 0], pixels[:, 1]])
    _, rotation, _, _ = _resection(points, mirrored)
    roll = np.degrees(np.arctan2(rotation[1, 0], rotation[0, 0]))
    if 45 < abs(roll) < 135:
        raise CalibrationError(
            "the projector's rows and columns are exchanged: give the photographs of the columns "
            'first, or exchange its width and height'
        )
    raise CalibrationError(
        "the projector's image is mirrored: switch its rear projection or ceiling mode off, and "
        "the flipping of photographs in the camera's driver, or see that width and height are the "
        'right way round'
    )


def _turns_over(plane: NDArray, pixels: NDArray) -> bool:
    """Whether the map from the board to the pixels reverses the sense of rotation."""
    known = np.isfinite(pixels).all(axis=1)
    ends = plane[known] - plane[known].mean(axis=0)
    linear, *_ = np.linalg.lstsq(ends, pixels[known] - pixels[known].mean(axis=0), rcond=None)
    return bool(np.linalg.det(linear) < 0)


def _listed(names: list[str]) -> str:
    return ', '.join(names[:3]) + (f' and {len(names) - 3} more' if len(names) > 3 else '')
