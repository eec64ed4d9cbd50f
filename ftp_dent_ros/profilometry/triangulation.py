"""From projector columns to points: a camera ray meets the plane of a column (section 2.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.rig.rig import Rig

# Of Newton's method for the projector's distortion.
_NEWTON_STEPS = 3


def triangulate(
    rig: Rig, rays: NDArray[np.float32], columns: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Depth of the points where camera rays meet the light of projector columns.

    A column is a plane ``X_p = q Z_p`` with ``q = (u_p - c_x) / f_x``, and a point on the ray is
    ``z ray``, so that ``z = (q t_z - t_x) / (r_1 . ray - q r_3 . ray)`` with the rows r of the
    rotation. With lens distortion a column is bent: q depends on v_p, which the point itself
    gives (the epipolar line), and Newton's steps settle both.

    Parameters
    ----------
    rig : Rig
    rays : ndarray, shape (rows, columns, 3)
        Undistorted rays of the camera, z = 1.
    columns : ndarray, shape (rows, columns)
        u_p, projector pixels; NaN gives NaN.

    Returns
    -------
    depth : ndarray, shape (rows, columns), float32
        z in the camera's frame, metres; NaN where ray and plane do not meet in front.
    v_p : ndarray, shape (rows, columns), float32
        Row of the projector, pixels.
    """
    return meet(rig, turned(rig, rays), columns)


def turned(rig: Rig, rays: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """The camera's rays (z = 1) in the projector's frame: r_1 . ray, r_2 . ray, r_3 . ray."""
    x, y = rays[..., 0], rays[..., 1]
    return [r_x * x + r_y * y + r_z for r_x, r_y, r_z in rig.rotation.astype(np.float32)]


def meet(
    rig: Rig, along: Sequence[NDArray[np.float32]], columns: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What `triangulate` returns, of rays in the projector's frame (`turned`)."""
    (f_x, _, c_x), (_, f_y, c_y), _ = rig.projector.camera_matrix.astype(np.float32)
    t_x, t_y, t_z = rig.translation.astype(np.float32)
    seen = (columns - c_x) / f_x

    def crossing(q):
        depth = (q * t_z - t_x) / (along[0] - q * along[2])
        ahead = depth * along[2] + t_z
        return depth, ahead, (depth * along[1] + t_y) / ahead

    q = seen
    depth, ahead, row = crossing(q)
    bent = row
    if rig.projector.distortion.any():
        for _ in range(_NEWTON_STEPS):
            image, slope, bent = _distort(rig.projector.distortion.astype(np.float32), q, row)
            q = q + (seen - image) / slope
            depth, ahead, row = crossing(q)
        _, _, bent = _distort(rig.projector.distortion.astype(np.float32), q, row)
    in_front = (depth > 0) & (ahead > 0)
    np.copyto(depth, np.float32(np.nan), where=~in_front)
    return depth, f_y * bent + c_y


def _distort(distortion, x, y):
    """Distorted x, its derivative by x, and distorted y (plumb_bob)."""
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )
