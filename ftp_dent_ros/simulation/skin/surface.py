"""The surface that is looked at: a union of panels, in one frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.skin.nearest import signed_distance
from ftp_dent_ros.simulation.skin.panel import Panel


@dataclass(frozen=True, eq=False)
class Surface:
    """A union of panels in one frame; several of them make laps, steps and gaps.

    Attributes
    ----------
    panels : tuple of Panel
    """

    panels: tuple[Panel, ...]

    def transformed(self, pose: Pose) -> Surface:
        """The same surface in the parent frame of `pose`."""
        return Surface(tuple(replace(panel, pose=pose @ panel.pose) for panel in self.panels))

    def intersect(self, rays: ArrayLike, origin: ArrayLike = (0, 0, 0)) -> NDArray[np.float64]:
        """Where rays first meet the surface.

        Parameters
        ----------
        rays : ndarray, shape (..., 3)
            Directions; with z = 1 and the origin in the camera, the result is the depth.
        origin : ndarray, shape (3,)

        Returns
        -------
        ndarray, shape (...)
            The surface is at ``origin + result * ray``; NaN where the ray meets nothing.
        """
        rays = np.asarray(rays, float)
        flat = rays.reshape(-1, 3)
        start = np.asarray(origin, float)
        nearest = np.full(len(flat), np.inf)
        for panel in self.panels:
            scale, x, y = panel.hit_bare(start, flat)
            hit = np.flatnonzero(np.isfinite(scale))
            scale, x, y, towards = scale[hit], x[hit], y[hit], flat[hit]
            local = panel.near(x, y)
            local.hit_features(start, towards, scale, x, y)
            scale[~panel.contains(x, y)] = np.inf
            nearest[hit] = np.minimum(nearest[hit], scale)
        nearest[np.isinf(nearest)] = np.nan
        return nearest.reshape(rays.shape[:-1])

    def distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Signed distance to the closest point of the surface, metres.

        Parameters
        ----------
        points : ndarray, shape (..., 3)

        Returns
        -------
        ndarray, shape (...)
            Positive behind the surface (inside the aircraft), NaN for points that are not finite.
        """
        points = np.asarray(points, float)
        flat = points.reshape(-1, 3)
        finite = np.isfinite(flat).all(axis=1)
        inside = flat[finite]
        best = np.full(len(inside), np.inf)
        for panel in self.panels:
            distance = signed_distance(panel, inside)
            best = np.where(np.abs(distance) < np.abs(best), distance, best)
        result = np.full(len(flat), np.nan)
        result[finite] = best
        return result.reshape(points.shape[:-1])
