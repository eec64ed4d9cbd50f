"""How far what every camera pixel sees moves during an exposure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation.photography.motion import Motion, Rays
from ftp_dent_ros.simulation.photography.pixel_grid import pixel_grid
from ftp_dent_ros.simulation.photography.tracing import View, projector_pixel
from ftp_dent_ros.simulation.skin.panel import Panel
from ftp_dent_ros.simulation.skin.surface import Surface


def image_sweep(rig: Rig, surface: Surface, motion: Motion) -> float:
    """How far the image moves during the exposure, at most, pixels."""
    if not motion:
        return 0.0
    rays = pixel_grid(rig.camera).node_rays[::4, ::4].reshape(-1, 3)
    depth = surface.intersect(rays)
    seen = np.isfinite(depth)
    points = depth[seen, None] * rays[seen]
    moved = Rotation.from_rotvec(motion.rotation).apply(points) + motion.translation
    shift = rig.camera.project(moved) - rig.camera.project(points)
    return float(np.hypot(*shift.T).max(initial=0.0))


def light_drift(rig: Rig, surface: Surface, view: View, motion: Motion) -> NDArray[np.float32]:
    """How far the projector pixel (u, v) that a pixel sees moves during the exposure.

    That of the bare skin: it only sets how far the blur reaches. Where skin slides past by a
    tenth of a small dent's width, that is right to one or two grey levels.

    Returns
    -------
    ndarray, shape (2, height, width)
    """
    return _drift(
        rig,
        surface,
        view,
        motion,
        lambda _, rays, scale: projector_pixel(rig, scale[:, None] * rays.directions),
    )


def skin_drift(rig: Rig, surface: Surface, view: View, motion: Motion) -> NDArray[np.float32]:
    """How far the panel coordinates (x, y) that a pixel sees move during the exposure, metres.

    Those of the bare skin. Shape (2, height, width).
    """

    def place(panel: Panel, rays: Rays, _: NDArray) -> tuple[NDArray, NDArray]:
        return panel.hit_bare(rays.origin, rays.towards)[1:]

    return _drift(rig, surface, view, motion, place)


def _drift(
    rig: Rig,
    surface: Surface,
    view: View,
    motion: Motion,
    place: Callable[[Panel, Rays, NDArray], tuple[NDArray, NDArray]],
) -> NDArray[np.float32]:
    """How far what is seen moves during the exposure, shape (2, height, width)."""
    grid = pixel_grid(rig.camera)
    nodes = grid.node_rays.reshape(-1, 1, 3)
    drift = np.zeros((2, *grid.shape), np.float32)
    for index, panel in enumerate(surface.panels):
        ends = []
        for moment in (-0.5, 0.5):
            rays = motion.rays(nodes, [moment])
            scale, _, _ = panel.hit_bare(rays.origin, rays.towards)
            ends.append(np.stack(place(panel, rays, scale)))
        change = np.nan_to_num(ends[1] - ends[0]).reshape(2, *grid.node_rays.shape[:2])
        for target, values in zip(drift, change.astype(np.float32), strict=True):
            np.copyto(target, grid.interpolated(values), where=view.tone // 2 == index)
    return drift
