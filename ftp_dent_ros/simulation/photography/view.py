"""What every camera pixel sees, quickly.

The bare skin is smooth, so it is traced at nodes at most 16 pixels and 0.01 radians apart and
interpolated (cubic, to 1e-4 pixels); pixels on dents are traced one by one. Fittings, and what
else changes within a pixel, are left to `broken_pixels`, where a caller has to sample finer.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation.photography.motion import still
from ftp_dent_ros.simulation.photography.photometry import Photometry
from ftp_dent_ros.simulation.photography.pixel_grid import PixelGrid, pixel_grid
from ftp_dent_ros.simulation.photography.tracing import Sight, View, first_seen, sight
from ftp_dent_ros.simulation.skin.dent import Dent
from ftp_dent_ros.simulation.skin.fitting import Fitting
from ftp_dent_ros.simulation.skin.panel import Panel
from ftp_dent_ros.simulation.skin.surface import Surface

# Windows around features are wider than their outline by this many pixels.
_AROUND = 4
# Motion during an exposure brings nothing into view from farther than this, metres.
_OUT_OF_VIEW = 0.05
_EYE = np.zeros(3)

Window = tuple[slice, slice]


def visible_part(rig: Rig, surface: Surface) -> Surface:
    """The surface with only those dents and fittings that the camera may see."""
    rays = pixel_grid(rig.camera).node_rays.reshape(-1, 3)
    panels = []
    for panel in surface.panels:
        scale, x, y = panel.hit_bare(_EYE, rays)
        hit = np.isfinite(scale)
        panels.append(panel.near(x[hit], y[hit], _OUT_OF_VIEW))
    return Surface(tuple(panels))


def see(rig: Rig, surface: Surface, photometry: Photometry) -> View:
    """What each pixel's centre sees, without fittings: arrays of shape (height, width)."""
    grid = pixel_grid(rig.camera)
    sights = [_sight(grid, rig, panel, photometry) for panel in surface.panels]
    return first_seen(rig, surface, sights, grid.rays)


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
