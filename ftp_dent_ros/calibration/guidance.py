"""What guides a capture: how late the projector is, which pose helps most, how far it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.calibration.board import Board
from ftp_dent_ros.calibration.bundle import (
    Model,
    adjust,
    covariance,
    depth_slopes,
    with_pose,
)
from ftp_dent_ros.calibration.observing import Observation
from ftp_dent_ros.calibration.start import first_rig
from ftp_dent_ros.errors import CalibrationError
from ftp_dent_ros.rig.rig import Rig

# Tilt of the candidates, degrees, and their distances as parts of the median so far.
_TILT = 28.0
_DISTANCES = {'closer': 0.75, '': 1.0, 'farther': 1.3}
_TILTS = {
    '': (0, 0),
    'its left side away by 30 degrees': (0, -_TILT),
    'its right side away by 30 degrees': (0, _TILT),
    'its upper side away by 30 degrees': (_TILT, 0),
    'its lower side away by 30 degrees': (-_TILT, 0),
}
_PLACES = {
    'in the middle': (0.5, 0.5),
    'at the left': (0.3, 0.5),
    'at the right': (0.7, 0.5),
    'at the top': (0.5, 0.33),
    'at the bottom': (0.5, 0.67),
}
# Until there is a rig to reckon with.
_FIRST = (
    'in the middle of the image, facing the camera',
    'in the middle, its left side away by 30 degrees',
    'in the middle, its upper side away by 30 degrees',
    'closer, its right side away by 30 degrees',
)
# Terms that a few poses hold down.
_MODEL = Model(1, 1)


def projector_delay(
    show: Callable[[NDArray[np.uint8]], int],
    photograph: Callable[[int], tuple[NDArray[np.uint8], int]],
    size: tuple[int, int],
) -> float:
    """Time from the message to the light, seconds: until photographs no longer change.

    The projector goes from black to white; the delay ends at the first photograph that is as
    bright as the last, so that it holds the projector's own frame and the camera's error of
    stamps, and is right to the time between two photographs.
    """
    black, white = (np.full((size[1], size[0], 3), level, np.uint8) for level in (0, 254))
    photograph(show(black))
    shown_ns = show(white)
    images, stamps_ns = zip(*(photograph(0) for _ in range(8)), strict=True)
    levels = np.array([image.mean() for image in images])
    late = np.flatnonzero(levels < 0.95 * levels[-1])
    return max(0.0, (stamps_ns[late[-1] + 1] - shown_ns) / 1e9) if len(late) else 0.0


def next_pose(
    observations: list[Observation],
    board: Board,
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
) -> tuple[str, float]:
    """Where to hold the board next, and how well depths are known so far.

    With a rig estimated from the poses so far, each candidate's contribution to the normal
    equations is added, and the one is named that leaves the least uncertainty of the depth
    (A-optimality).

    Returns
    -------
    advice : str
        A sentence.
    deviation : float
        Standard deviation of depths over the image, metres (median); NaN before it is known.
    """
    lit = [o for o in observations if o.has_projector]
    if len(lit) < len(_FIRST):
        return f'hold the board {_FIRST[len(lit)]}', np.nan
    try:
        start = first_rig(lit, board.points, camera_size, projector_size)
    except CalibrationError as reason:
        return f'hold the board {_FIRST[-1]} ({reason})', np.nan
    estimate = adjust(start, _MODEL, tolerance=1e-5)
    rig, distance = estimate.rig, float(np.median(start.poses[:, 5]))
    pixels = rig.camera.pixel_grid()[:: camera_size[1] // 5, :: camera_size[0] // 6].reshape(-1, 2)
    depth = np.full(len(pixels), distance)
    best = np.inf, 'wherever camera and projector see all of it'
    slopes, known = depth_slopes(rig, pixels, depth), covariance(estimate, _MODEL)

    def uncertainty(of: NDArray) -> float:
        return float(np.median(np.sqrt(((slopes @ of) * slopes).sum(axis=1))))

    middle, size = board.points.mean(axis=0), np.array(camera_size)
    for (far, scale), (side, tilt), (place, at) in product(
        _DISTANCES.items(), _TILTS.items(), _PLACES.items()
    ):
        turn = Rotation.from_euler('xy', tilt, degrees=True)
        shift = distance * scale * rig.camera.rays(at * size) - turn.apply(middle)
        more = replace(estimate, poses=np.concatenate([turn.as_rotvec(), shift])[None])
        seen = _seen(rig, more.points()[0])
        if seen is not None:
            left = uncertainty(with_pose(known, replace(more, observations=[seen]), _MODEL))
            words = filter(None, (f'{place} of the image', far, side))
            best = min(best, (left, ', '.join(words)))
    return f'hold the board {best[1]}', uncertainty(known)


def covered(observations: list[Observation], camera_size: tuple[int, int]) -> float:
    """Share of a grid of 6 x 4 fields of the image in which a corner was seen."""
    corners = np.concatenate([np.empty((0, 2)), *(each.camera for each in observations)])
    u, v = corners[np.isfinite(corners[:, 0])].T
    width, height = camera_size
    seen, *_ = np.histogram2d(u, v, (6, 4), ((0, width), (0, height)))
    return float((seen > 0).mean())


def _seen(rig: Rig, points: NDArray) -> Observation | None:
    """What would be observed; None if camera or projector do not see the whole board."""
    pixels = rig.camera.project(points), rig.projector.project(rig.to_projector(points))
    for lens, pixel in zip((rig.camera, rig.projector), pixels, strict=True):
        # Corners so near to the rim are not found, pixels.
        if (pixel < 4).any() or (pixel > [lens.width - 4, lens.height - 4]).any():
            return None
    return Observation('', *pixels)
