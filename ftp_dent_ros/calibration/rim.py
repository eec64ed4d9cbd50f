"""The rims of the projector's frame at which the fringes end: there rows are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ftp_dent_ros.pattern import Pattern
from ftp_dent_ros.rig import Rig

# Fewer places than this are no rim.
_FEWEST = 12
# Half the length of a profile across the rim, camera pixels.
_REACH = 14
# From the dark around the frame to the light in it, at least, grey levels.
_LEAST_STEP = 8.0


def inverse_depth(rays: NDArray) -> NDArray[np.float64]:
    """Terms of the inverse depth along rays: three of a plane, three of its bend."""
    x, y = rays[:, 0], rays[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def find_rim(
    rig: Rig, pattern: Pattern, levels: NDArray, shape: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places on the two rims of the frame at which the fringes end.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    levels : ndarray, shape (height, width)
        Of the photograph.
    shape : ndarray, shape (6,)
        Of the surface, as in `inverse_depth`.

    Returns
    -------
    pixels : ndarray, shape (n, 2)
        Of the camera.
    rows : ndarray, shape (n,)
        Projector rows of these rims; columns for fringes of the axis v.
    """
    upright = pattern.axis == 'u'
    across_fringes, along_fringes = rig.projector.width, rig.projector.height
    if not upright:
        across_fringes, along_fringes = along_fringes, across_fringes
    bright = np.arange(
        pattern.stripe_center_px % pattern.period_px, across_fringes, pattern.period_px
    )
    pixels, rows = [], []
    for row, inward in ((-0.5, 1.0), (along_fringes - 0.5, -1.0)):
        edge = np.column_stack([bright, np.full(len(bright), row)])
        places = [edge + np.array([0, inward * step]) for step in (0.0, 8.0)]
        ends = [_lit(rig, each if upright else each[:, ::-1], shape) for each in places]
        across = ends[1] - ends[0]
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        offsets = np.arange(-_REACH, _REACH + 0.25, 0.25)
        profile_at = ends[0][:, None] + offsets[:, None] * across[:, None]
        limits = np.array([rig.camera.width - 1, rig.camera.height - 1])
        inside = ((profile_at > 0) & (profile_at < limits)).all(axis=(1, 2))
        for place, way, where in zip(
            ends[0][inside], across[inside], profile_at[inside], strict=True
        ):
            profile = map_coordinates(levels, where[:, ::-1].T, order=1)
            offset = _step(profile, offsets)
            if np.isfinite(offset):
                pixels.append(place + offset * way)
                rows.append(row)
    if len(rows) < _FEWEST:
        return np.zeros((0, 2)), np.zeros(0)
    return np.array(pixels), np.array(rows)


def _step(profile: NDArray, offsets: NDArray) -> float:
    """Where a profile crosses the middle between dark and light; NaN where there is no edge."""
    dark, light = np.median(profile[:16]), np.median(profile[-24:])
    if light - dark < _LEAST_STEP or light > 250:
        return np.nan
    above = profile > (dark + light) / 2
    crossings = np.flatnonzero(~above[:-1] & above[1:])
    if len(crossings) != 1:
        return np.nan
    index = crossings[0]
    part = ((dark + light) / 2 - profile[index]) / (profile[index + 1] - profile[index])
    return float(offsets[index] + part * 0.25)


def _lit(rig: Rig, pixels: NDArray, shape: NDArray) -> NDArray[np.float64]:
    """Camera pixels that see what projector pixels light on the surface."""
    rays = rig.projector.rays(pixels) @ rig.rotation
    centre = rig.projector_centre
    scale = np.full(len(rays), 1 / shape[0])
    for _ in range(20):
        points = centre + scale[:, None] * rays
        depth = 1 / (inverse_depth(points / points[:, 2:]) @ shape)
        scale += (depth - points[:, 2]) / rays[:, 2]
    return rig.camera.project(centre + scale[:, None] * rays)
