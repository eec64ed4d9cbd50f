"""What every camera pixel sees, quickly.

The bare skin is smooth, so it is traced at nodes at most 16 pixels and 0.01 radians apart and
interpolated (cubic, to 1e-4 pixels); pixels on dents are traced one by one. Fittings, and what
else changes within a pixel, are left to `broken_pixels`, where a caller has to sample finer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from ftp_dent_ros.rig import Lens, Rig
from ftp_dent_ros.simulation.dent import Dent
from ftp_dent_ros.simulation.fittings import Fitting
from ftp_dent_ros.simulation.motion import Motion, Rays, still
from ftp_dent_ros.simulation.panel import Panel
from ftp_dent_ros.simulation.photometry import Photometry
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.tracing import Sight, View, first_seen, projector_pixel, sight

# Pixels, and focal lengths.
_NODE_SPACING = 16
_NODE_ANGLE = 0.01
# Windows around features are wider than their outline by this many pixels.
_AROUND = 4
# Motion during an exposure brings nothing into view from farther than this, metres.
_OUT_OF_VIEW = 0.05
_EYE = np.zeros(3)

Window = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class PixelGrid:
    """The pixels of a lens, and how to interpolate to them from a coarse grid of nodes.

    Attributes
    ----------
    rays : ndarray, shape (height, width, 3)
    node_rays : ndarray, shape (n, m, 3)
    rows, columns : scipy.sparse.csr_matrix, shape (height, n) and (width, m)
        ``rows @ nodes @ columns.T`` is the values at every pixel.
    vignette : ndarray, shape (height, width), float32
        The cos^4 law.
    """

    rays: NDArray[np.float64]
    node_rays: NDArray[np.float64]
    rows: csr_matrix
    columns: csr_matrix
    vignette: NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.rays.shape[0], self.rays.shape[1]

    def interpolated(self, nodes: NDArray) -> NDArray:
        """Values at every pixel, shape (height, width), of values at the nodes."""
        return self.rows.astype(nodes.dtype) @ (self.columns @ nodes.T).T.astype(nodes.dtype)

    def rays_within(
        self, pixels: NDArray[np.intp], along_u: NDArray, along_v: NDArray
    ) -> NDArray[np.float64]:
        """Rays through points within pixels.

        Parameters
        ----------
        pixels : ndarray, shape (n,)
            Flat indices.
        along_u, along_v : ndarray, shape (m,)
            Offsets from the pixels' centres.

        Returns
        -------
        ndarray, shape (n, m, 3)
        """
        row, column = np.divmod(pixels, self.shape[1])
        rays = self.rays[row, column][:, None]
        for offset, axis, index in ((along_u, 1, column), (along_v, 0, row)):
            after = np.minimum(index + 1, self.shape[axis] - 1)
            before = np.maximum(index - 1, 0)
            ends = (row, after, before) if axis else (column, after, before)
            higher = self.rays[ends[0], ends[1]] if axis else self.rays[ends[1], ends[0]]
            lower = self.rays[ends[0], ends[2]] if axis else self.rays[ends[2], ends[0]]
            slope = (higher - lower) / (after - before)[:, None]
            rays = rays + slope[:, None] * offset[:, None]
        return rays


@lru_cache(maxsize=4)
def pixel_grid(lens: Lens) -> PixelGrid:
    """Grid of a lens; the last few lenses' are kept."""
    u, columns = _interpolation(lens.width, lens.camera_matrix[0, 0])
    v, rows = _interpolation(lens.height, lens.camera_matrix[1, 1])
    node_rays = lens.rays(np.stack(np.meshgrid(u, v), axis=-1))
    rays = np.stack([rows @ node_rays[..., i] @ columns.T for i in range(3)], axis=-1)
    vignette = 1 / np.sum(rays * rays, axis=-1) ** 2
    return PixelGrid(rays, node_rays, rows, columns, vignette.astype(np.float32))


def visible_part(rig: Rig, surface: Surface) -> Surface:
    """The surface with only those dents and fittings that the camera may see."""
    rays = pixel_grid(rig.camera).node_rays.reshape(-1, 3)
    panels = []
    for panel in surface.panels:
        scale, x, y = panel.hit_bare(_EYE, rays)
        hit = np.isfinite(scale)
        panels.append(panel.near(x[hit], y[hit], _OUT_OF_VIEW))
    return Surface(tuple(panels))


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


def see(rig: Rig, surface: Surface, photometry: Photometry) -> View:
    """What each pixel's centre sees, without fittings: arrays of shape (height, width)."""
    grid = pixel_grid(rig.camera)
    sights = [_sight(grid, rig, panel, photometry) for panel in surface.panels]
    return first_seen(rig, surface, sights, grid.rays)


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


def broken_pixels(rig: Rig, surface: Surface, view: View, sweep: float) -> list[NDArray[np.intp]]:
    """Flat indices of pixels within which what they see changes abruptly.

    Parameters
    ----------
    sweep : float
        How far the image moves during the exposure, pixels.

    Returns
    -------
    list of ndarray
        None is empty. The borders of panels, tones and shadows, then each fitting in view.
    """
    grid = pixel_grid(rig.camera)
    reach = 1 + math.ceil(sweep / 2)
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    border = np.zeros(grid.shape, bool)
    for label in (view.tone, view.shadow.view(np.uint8)):
        if label.min() != label.max():
            border |= cv2.dilate(label, square) != cv2.erode(label, square)
    broken = [np.flatnonzero(border)]
    broken += [
        _on_fitting(grid, rig.camera, panel, fitting, reach)
        for panel in surface.panels
        for fitting in panel.rivets
    ]
    return [pixels for pixels in broken if len(pixels)]


def _sight(grid: PixelGrid, rig: Rig, panel: Panel, photometry: Photometry) -> Sight:
    """Sight of one panel at every pixel; NaN where it is not seen."""
    coarse = sight(rig, panel, still(grid.node_rays.reshape(-1, 3)), photometry, bare=True)
    missing = ~np.isfinite(sum(coarse)).reshape(grid.node_rays.shape[:2])
    if missing.all():
        return Sight(*(np.full(grid.shape, np.nan) for _ in coarse))
    # Projector pixels to 1e-4 need double precision, the rest does not.
    fields = (
        np.nan_to_num(values, posinf=0, neginf=0)
        .reshape(missing.shape)
        .astype(np.float64 if name in 'uv' else np.float32)
        for name, values in zip(Sight._fields[:-1], coarse, strict=False)
    )
    dense = Sight(*map(grid.interpolated, fields), np.ones(grid.shape, np.float32))  # type: ignore[call-arg]
    patches: list[Window | NDArray[np.bool_]] = []
    if missing.any():
        patches.append(abs(grid.rows) @ missing @ abs(grid.columns).T > 0)
    patches += [
        window for dent in panel.dents if (window := _window(rig.camera, panel, dent)) is not None
    ]
    for patch in patches:
        exact = sight(rig, panel, still(grid.rays[patch].reshape(-1, 3)), photometry)
        for part, values in zip(dense, exact, strict=True):
            part[patch] = values.reshape(part[patch].shape)
    return dense


def _interpolation(size: int, focal: float) -> tuple[NDArray[np.float64], csr_matrix]:
    """Nodes over 0 ... size - 1, and the matrix of Lagrange's cubic from them to each pixel."""
    spacing = min(_NODE_SPACING, _NODE_ANGLE * focal)
    count = max(4, min(math.ceil((size - 1) / spacing) + 1, size))
    nodes = np.linspace(0, size - 1, count)
    position = np.arange(size) / max(size - 1, 1) * (count - 1)
    first = np.clip(np.floor(position).astype(int) - 1, 0, count - 4)
    t = position - first
    weights = np.zeros((size, count))
    for k in range(4):
        others = [j for j in range(4) if j != k]
        weight = np.prod([(t - j) / (k - j) for j in others], axis=0)
        weights[np.arange(size), first + k] = weight
    return nodes, csr_matrix(weights)


def _window(lens: Lens, panel: Panel, feature: Dent | Fitting) -> Window | None:
    """Part of the image that may show a feature; None where it is out of the image."""
    # A ray that slants at 70 degrees meets a bulge three heights before the bare skin.
    half = feature.reach + 3 * feature.rise
    offsets = [(i * half, j * half) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    x, y = (np.array([feature.x, feature.y]) + offsets).T
    height, _, _ = panel.bare_height(x, y)
    points = panel.pose.apply(np.stack([x, y, height], axis=-1))
    if (points[:, 2] <= 0).all():
        return None
    if (points[:, 2] <= 0).any():
        return slice(0, lens.height), slice(0, lens.width)
    pixels = lens.project(points)
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - _AROUND, 0)
    high = np.ceil(pixels.max(axis=0)).astype(int) + _AROUND + 1
    high = np.minimum(high, [lens.width, lens.height])
    if (low >= high).any():
        return None
    return slice(low[1], high[1]), slice(low[0], high[0])


def _on_fitting(
    grid: PixelGrid, lens: Lens, panel: Panel, fitting: Fitting, reach: int
) -> NDArray[np.intp]:
    """Flat indices of the pixels within `reach` pixels of what is sharp on a fitting."""
    window = _window(lens, panel, fitting)
    if window is None:
        return np.zeros(0, np.intp)
    rays = grid.rays[window]
    _, x, y = (part.reshape(rays.shape[:2]) for part in panel.hit_bare(_EYE, rays.reshape(-1, 3)))
    steps = (np.hypot(np.diff(x, axis=i), np.diff(y, axis=i)) for i in (0, 1))
    pixel = max(step.max(initial=0.0) for step in steps)
    rows, columns = np.nonzero(fitting.sharp(x, y, reach * pixel))
    return (rows + window[0].start) * lens.width + columns + window[1].start
