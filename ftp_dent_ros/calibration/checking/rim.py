"""The rims of the projector's frame at which the fringes end: there rows are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.rig.rig import Rig

# Fewer places than this are no rim.
_FEWEST = 12
# Half the length of a profile across the rim, camera pixels.
_REACH = 14
# A place so many projector pixels inside the rim tells which way is inward.
_INWARD = 8.0
# From the dark around the frame to the light in it, at least, grey levels.
_LEAST_STEP = 8.0
# Quartiles of a normal distribution are so many standard deviations apart.
_QUARTILES = 1.349


@dataclass(frozen=True, eq=False)
class Rim:
    """Places on the rims of the frame.

    Attributes
    ----------
    pixels : ndarray, shape (n, 2)
        Of the camera: where the light is half of what it is inside.
    rows : ndarray, shape (n,)
        Projector rows of these rims; columns for fringes of the axis v.
    blur : ndarray, shape (n,)
        Standard deviation of the edge's blur, projector rows, positive if the frame is below.
    """

    pixels: NDArray[np.float64]
    rows: NDArray[np.float64]
    blur: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.rows)

    def sides(self) -> list[NDArray[np.bool_]]:
        """Which places belong to each of the rims seen."""
        return [self.rows == row for row in np.unique(self.rows)]


NO_RIM = Rim(np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def inverse_depth(rays: NDArray) -> NDArray[np.float64]:
    """Terms of the inverse depth along rays: three of a plane, three of its bend."""
    x, y = rays[:, 0], rays[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def find_rim(rig: Rig, pattern: Pattern, levels: NDArray, shape: NDArray) -> Rim:
    """Places on the two rims of the frame at which the fringes end.

    Parameters
    ----------
    rig : Rig
    pattern : Pattern
    levels : ndarray, shape (height, width)
        Of the photograph, growing with the light.
    shape : ndarray, shape (6,)
        Of the surface, as in `inverse_depth`.

    Returns
    -------
    Rim
        Without a place where too few are seen.
    """
    upright = pattern.axis == 'u'
    across_fringes, along_fringes = rig.projector.width, rig.projector.height
    if not upright:
        across_fringes, along_fringes = along_fringes, across_fringes
    bright = np.arange(
        pattern.stripe_center_px % pattern.period_px, across_fringes, pattern.period_px
    )
    # Once for all profiles: SciPy would filter the whole photograph for each.
    cubic = spline_filter(levels)
    pixels, rows, blurs = [], [], []
    for row, inward in ((-0.5, 1.0), (along_fringes - 0.5, -1.0)):
        edge = np.column_stack([bright, np.full(len(bright), row)])
        places = [edge + np.array([0, inward * step]) for step in (0.0, _INWARD)]
        ends = [_lit(rig, each if upright else each[:, ::-1], shape) for each in places]
        across = ends[1] - ends[0]
        length = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
        across /= length[:, None]
        offsets = np.arange(-_REACH, _REACH + 0.25, 0.25)
        profile_at = ends[0][:, None] + offsets[:, None] * across[:, None]
        limits = np.array([rig.camera.width - 1, rig.camera.height - 1])
        inside = ((profile_at > 0) & (profile_at < limits)).all(axis=(1, 2))
        for place, way, per_pixel, where in zip(
            ends[0][inside],
            across[inside],
            inward * _INWARD / length[inside],
            profile_at[inside],
            strict=True,
        ):
            profile = map_coordinates(
                cubic, where[:, ::-1].T, output=levels.dtype, prefilter=False
            )
            offset, blur = _step(profile, offsets)
            if np.isfinite(offset):
                pixels.append(place + offset * way)
                rows.append(row)
                blurs.append(blur * per_pixel)
    if len(rows) < _FEWEST:
        return NO_RIM
    return Rim(np.array(pixels), np.array(rows), np.array(blurs))


def _step(profile: NDArray, offsets: NDArray) -> tuple[float, float]:
    """Where a profile is half dark, half light, and its blur's deviation; NaN without an edge."""
    dark, light = np.median(profile[:16]), np.median(profile[-24:])
    if light - dark < _LEAST_STEP or light > 250:
        return np.nan, np.nan
    share = (profile - dark) / (light - dark)
    above = share > 0.5
    crossings = np.flatnonzero(~above[:-1] & above[1:])
    if len(crossings) != 1:
        return np.nan, np.nan
    index = crossings[0]
    first = index - int(np.argmax(share[index::-1] <= 0.25))
    last = index + 1 + int(np.argmax(share[index + 1 :] >= 0.75))
    before = np.interp(0.25, share[first : first + 2], offsets[first : first + 2])
    behind = np.interp(0.75, share[last - 1 : last + 1], offsets[last - 1 : last + 1])
    middle = np.interp(0.5, share[index : index + 2], offsets[index : index + 2])
    return float(middle), float(behind - before) / _QUARTILES


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
