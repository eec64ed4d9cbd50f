"""The closest point of a panel: signed distances to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.skin.panel import Panel

# Of Gauss and Newton.
_ITERATIONS = 12
# Metres on the panel.
_CONVERGED = 1e-11

Field = NDArray[np.float64]


def signed_distance(panel: Panel, points: Field) -> Field:
    """Signed distance of points (n, 3) in the panel's parent frame, positive behind the skin.

    The closest point lies within the extent. To 1e-6 m for points within a few millimetres
    of the skin; of points far away the nearest of several dents may be missed.
    """
    at = panel.pose.inverse().apply(points)
    foot_x, foot_y = _closest_bare(panel, at)
    height, _, _ = panel.bare_height(foot_x, foot_y)
    above = at[:, 2] - height
    distance = np.sqrt((at[:, 0] - foot_x) ** 2 + (at[:, 1] - foot_y) ** 2 + above**2)
    behind = above >= 0
    margin = distance + max((feature.rise for feature in panel.features), default=0.0)
    local = panel.near(foot_x, foot_y, float(margin.max(initial=0.0)))
    near = np.flatnonzero(local.covered(foot_x, foot_y, margin) | bool(panel.waves))
    if len(near):
        distance[near], behind[near] = _refined(local, at[near], foot_x[near], foot_y[near])
    return np.where(behind, distance, -distance)


def _refined(panel: Panel, at: Field, x: Field, y: Field) -> tuple[Field, NDArray[np.bool_]]:
    """Distance and side of points (n, 3) in the panel's frame, from feet near theirs."""
    x_min, x_max, y_min, y_max = panel.extent
    radius = panel.cylinder_radius
    best = np.full(len(x), np.inf)
    behind = np.zeros(len(x), bool)
    for _ in range(_ITERATIONS):
        height, hx, hy = panel.height(x, y)
        dx, dy, dz = at[:, 0] - x, at[:, 1] - y, at[:, 2] - height
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        closer = distance < best
        best[closer], behind[closer] = distance[closer], dz[closer] >= 0
        # Gauss-Newton on the squared distance, with the curvature of the bare skin added.
        bend = np.zeros(len(x))
        if radius:
            bend = np.minimum(dz * radius**2 / (radius**2 - x * x) ** 1.5, 0.8)
        xx, xy, yy = 1 + hx * hx - bend, hx * hy, 1 + hy * hy
        gradient_x, gradient_y = dx + hx * dz, dy + hy * dz
        determinant = xx * yy - xy * xy
        step_x = (yy * gradient_x - xy * gradient_y) / determinant
        step_y = (xx * gradient_y - xy * gradient_x) / determinant
        x = np.clip(x + step_x, x_min, x_max)
        y = np.clip(y + step_y, y_min, y_max)
        if max(np.abs(step_x).max(), np.abs(step_y).max()) < _CONVERGED:
            break
    return best, behind


def _closest_bare(panel: Panel, at: Field) -> tuple[Field, Field]:
    """Coordinates (x, y) of the closest points within the extent, features left out."""
    x_min, x_max, y_min, y_max = panel.extent
    x = at[:, 0]
    if panel.cylinder_radius:
        below = np.maximum(panel.cylinder_radius - at[:, 2], 1e-9)
        x = panel.cylinder_radius * x / np.hypot(x, below)
    return np.clip(x, x_min, x_max), np.clip(at[:, 1], y_min, y_max)
