"""What camera rays see of a surface: panel, paint, projector pixel and brightness."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation.dents import Feature, Field, within
from ftp_dent_ros.simulation.paint import dot
from ftp_dent_ros.simulation.sensor import Photometry
from ftp_dent_ros.simulation.surface import Panel, Surface

# A shadow's caster is at least this much nearer to the projector, as a part of the distance.
_CLEAR = 1e-5
# The tone of what is no panel.
NOTHING = 255
# A projector pixel far outside any image.
_NOWHERE = -1000.0

# Windows around features are wider than their outline by this many pixels.
_AROUND = 4
# Motion during an exposure brings nothing into view from farther than this, metres.
_OUT_OF_VIEW = 0.05

Window = tuple[slice, slice]


class Rays(NamedTuple):
    """Camera rays, each at its moment of the exposure.

    Attributes
    ----------
    directions : ndarray, shape (n, 3)
        In the camera's frame.
    origin : ndarray, shape (3,) or (n, 3)
        Where the rays start in the frame that the camera has in mid-exposure.
    towards : ndarray, shape (n, 3)
        Their directions in that frame; a point at ``origin + scale * towards`` there is at
        ``scale * directions`` in the camera's frame at the ray's moment.
    """

    directions: Field
    origin: Field
    towards: Field


def still(directions: Field) -> Rays:
    """Rays of shape (n, 3) in mid-exposure."""
    return Rays(directions, np.zeros(3), directions)


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """How the surface moves in the camera's frame during the exposure, at constant rates.

    Attributes
    ----------
    rotation : ndarray, shape (3,)
        Rotation vector from the exposure's begin to its end, radians.
    translation : ndarray, shape (3,)
        Metres.
    """

    rotation: Field = field(default_factory=lambda: np.zeros(3))
    translation: Field = field(default_factory=lambda: np.zeros(3))

    def rays(self, directions: Field, moments: ArrayLike) -> Rays:
        """Rays at moments of the exposure, with the motion of the surface undone.

        Parameters
        ----------
        directions : ndarray, shape (..., k, 3)
            In the camera's frame.
        moments : ndarray, shape (k,)
            -1/2 at the exposure's begin, 1/2 at its end.
        """
        moments = np.asarray(moments, float)[:, None]
        turn = Rotation.from_rotvec(-moments * self.rotation).as_matrix()
        start = -(turn @ (moments * self.translation)[..., None])[..., 0]
        towards = np.einsum('kij,...kj->...ki', turn, directions)
        origin = np.broadcast_to(start, directions.shape)
        return Rays(directions.reshape(-1, 3), origin.reshape(-1, 3), towards.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class PixelGrid:
    """The pixels of a lens, and how to interpolate to them from a coarse grid of nodes.

    Attributes
    ----------
    rays : ndarray, shape (height, width, 3)
    slopes : ndarray, shape (2, height, width, 3)
        Change of the rays from column to column and from row to row.
    node_rays : ndarray, shape (n, m, 3)
    rows, columns : scipy.sparse.csr_matrix, shape (height, n) and (width, m)
        ``rows @ nodes @ columns.T`` is the values at every pixel.
    vignette : ndarray, shape (height, width), float32
        The cos^4 law.
    """

    rays: NDArray[np.float64]
    slopes: NDArray[np.float64]
    node_rays: NDArray[np.float64]
    rows: csr_matrix
    columns: csr_matrix
    vignette: NDArray[np.float32]

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
        at = np.divmod(pixels, self.rays.shape[1])
        across, down = (slope[at][:, None] for slope in self.slopes)
        return self.rays[at][:, None] + across * along_u[:, None] + down * along_v[:, None]


@lru_cache(maxsize=4)
def pixel_grid(lens: Lens) -> PixelGrid:
    """Grid of a lens; the last few lenses' are kept."""
    u, columns = _interpolation(lens.width, lens.camera_matrix[0, 0])
    v, rows = _interpolation(lens.height, lens.camera_matrix[1, 1])
    node_rays = lens.rays(np.stack(np.meshgrid(u, v), axis=-1))
    rays = np.stack([rows @ node_rays[..., i] @ columns.T for i in range(3)], axis=-1)
    slopes = np.stack([np.gradient(rays, axis=axis) for axis in (1, 0)])
    vignette = 1 / np.sum(rays * rays, axis=-1) ** 2
    return PixelGrid(rays, slopes, node_rays, rows, columns, vignette.astype(np.float32))


def _interpolation(size: int, focal: float) -> tuple[NDArray[np.float64], csr_matrix]:
    """Nodes over 0 ... size - 1, and the matrix of Lagrange's cubic from them to each pixel."""
    # Between nodes, at most: pixels, and radians.
    spacing = min(16, 0.01 * focal)
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


class View(NamedTuple):
    """What rays see of a surface, or of one panel of it: arrays of one shape.

    Attributes
    ----------
    scale : ndarray
        The point is at ``scale * ray``.
    x, y : ndarray
        On the panel, metres.
    u, v : ndarray
        Projector pixel that lights it.
    diffuse : ndarray
        Irradiance at full light, 1 for the white patch of the photometry; 0 where nothing is lit.
    specular : ndarray
        The same times the varnish's reflectance.
    clean : ndarray
        Factor of dents and rivets on the albedo.
    tone : ndarray of uint8
        Column of `albedo_table` that holds the albedo: twice the panel's index, one more beyond
        its paint's edge, and `NOTHING` where no panel is.
    shadow : ndarray of bool
        Where another panel stands in the projector's way.
    """

    scale: NDArray
    x: NDArray
    y: NDArray
    u: NDArray
    v: NDArray
    diffuse: NDArray
    specular: NDArray
    clean: NDArray
    tone: NDArray[np.uint8]
    shadow: NDArray[np.bool_]


# The first eight of them, of one panel, also where it ends.
Sight = tuple[NDArray, ...]


def albedo_table(surface: Surface) -> NDArray[np.float32]:
    """Albedo of every tone that a view can have, shape (3, 256)."""
    paints = [panel.paint for panel in surface.panels]
    tones = np.zeros((256, 3), np.float32)
    tones[: 2 * len(paints) : 2] = [np.broadcast_to(each.albedo, 3) for each in paints]
    tones[1 : 2 * len(paints) : 2] = [np.broadcast_to(each.albedo_beyond, 3) for each in paints]
    return tones.T


def look(rig: Rig, surface: Surface, rays: Rays, photometry: Photometry) -> View:
    """What rays see of a surface that is given in mid-exposure."""
    sights = [sight(rig, panel, rays, photometry) for panel in surface.panels]
    return first_seen(rig, surface, sights, rays.directions)


def sight(rig: Rig, panel: Panel, rays: Rays, photometry: Photometry) -> Sight:
    """What rays see of one panel, beyond its extent too; NaN where they miss."""
    panel, (scale, x, y) = panel.hit(rays.origin, rays.towards)
    points = scale[:, None] * rays.directions
    u, v = projector_pixel(rig, points)
    diffuse, specular = _brightness(rig, panel, points, x, y, photometry)
    return scale, x, y, u, v, diffuse, specular, panel.clean(x, y)


def first_seen(rig: Rig, surface: Surface, sights: list[Sight], rays: NDArray) -> View:
    """Merge the sights of a surface's panels along rays of shape (..., 3): the nearest is seen."""
    seen = sights[0]
    nearest = np.full(seen[0].shape, np.inf)
    tone, shadow = np.full(nearest.shape, NOTHING, np.uint8), np.zeros(nearest.shape, bool)
    for index, (panel, sight) in enumerate(zip(surface.panels, sights, strict=True)):
        scale, x, y, *_ = sight
        closer = panel.contains(x, y) & (scale < nearest)
        np.copyto(nearest, scale, where=closer)
        np.copyto(tone, 2 * index + panel.paint.beyond_edge(x, y).astype(np.uint8), where=closer)
        for target, values in zip(seen, sight, strict=True):
            np.copyto(target, values, where=closer)
    if len(surface.panels) > 1:
        shadow = _shadowed(rig, surface, tone, nearest, rays)
    view = View._make((*seen, tone, shadow))
    unlit = ~np.isfinite(view.u + view.v)
    view.u[unlit] = view.v[unlit] = _NOWHERE
    unlit |= shadow | (tone == NOTHING)
    view.diffuse[unlit] = view.specular[unlit] = 0
    return view


def projector_pixel(rig: Rig, points: Field) -> tuple[Field, Field]:
    """Projector pixels that light points of shape (n, 3); NaN where the projector cannot."""
    seen = rig.to_projector(points)
    with np.errstate(all='ignore'):
        radius = np.hypot(seen[:, 0], seen[:, 1]) / seen[:, 2]
        # A lens model may fold far outside its image: beyond this part of its corner it casts no
        # light.
        reached = (seen[:, 2] > 0) & (radius < 1.2 * _corner(rig.projector))
        pixel = rig.projector.project(seen)
    pixel[~reached] = np.nan
    return pixel[:, 0], pixel[:, 1]


@lru_cache(maxsize=4)
def _corner(lens: Lens) -> float:
    """Largest distance of an image corner's ray from the axis."""
    right, bottom = lens.width - 0.5, lens.height - 0.5
    corners = lens.rays([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
    return float(np.hypot(corners[:, 0], corners[:, 1]).max())


def _brightness(
    rig: Rig, panel: Panel, points: Field, x: Field, y: Field, photometry: Photometry
) -> tuple[Field, Field]:
    """Diffuse and specular brightness of points of shape (n, 3) seen from the camera."""
    to_light = rig.projector_centre - points
    distance = np.sqrt(dot(to_light, to_light))
    to_light /= distance[:, None]
    to_eye = points / -np.sqrt(dot(points, points))[:, None]
    normal = panel.normal(x, y)
    if not photometry.shading:
        diffuse = np.ones(len(points))
    else:
        # The projector's image falls off with half the exponent of the cos^4 law, as that of a
        # retrofocus lens does; a lens without fall-off gives cos^-3.
        axial = -(to_light @ rig.rotation[2])
        incidence = np.maximum(dot(normal, to_light), 0)
        diffuse = incidence * (photometry.reference_distance / distance) ** 2 / axial
    diffuse = np.where(dot(normal, to_eye) < 0, 0, diffuse)
    specular = diffuse * panel.paint.specular(normal, to_light, to_eye)
    return diffuse, specular


def _shadowed(
    rig: Rig, surface: Surface, tone: NDArray, scale: NDArray, rays: NDArray
) -> NDArray[np.bool_]:
    """Where another panel than the one seen stands between it and the projector."""
    shadow = np.zeros(tone.shape, bool)
    for index, panel in enumerate(surface.panels):
        other = (tone != NOTHING) & (tone // 2 != index)
        points = scale[other][:, None] * rays[other]
        centre = rig.projector_centre
        part, x, y = panel.hit_bare(centre, points - centre)
        shadow[other] |= (part < 1 - _CLEAR) & panel.contains(x, y)
    return shadow


def visible_part(rig: Rig, surface: Surface) -> Surface:
    """The surface with only those dents and rivets that the camera may see."""
    rays = pixel_grid(rig.camera).node_rays.reshape(-1, 3)
    hits = [panel.hit_bare(np.zeros(3), rays) for panel in surface.panels]
    pairs = zip(surface.panels, hits, strict=True)
    return Surface(tuple(panel.near(x, y, _OUT_OF_VIEW) for panel, (_, x, y) in pairs))


def see(rig: Rig, surface: Surface, photometry: Photometry) -> View:
    """What each pixel's centre sees, without rivets: arrays of shape (height, width)."""
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
    border = np.zeros(view.tone.shape, bool)
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
    coarse = sight(rig, panel.bare, still(grid.node_rays.reshape(-1, 3)), photometry)
    missing = ~np.isfinite(sum(coarse)).reshape(grid.node_rays.shape[:2])
    if missing.all():
        return tuple(np.full(grid.vignette.shape, np.nan) for _ in coarse)
    dense = [
        grid.interpolated(
            np.nan_to_num(values, posinf=0, neginf=0)
            .reshape(missing.shape)
            # Projector pixels to 1e-4 need double precision, the rest does not.
            .astype(np.float64 if name in 'uv' else np.float32)
        )
        for name, values in zip(View._fields, coarse[:-1], strict=False)
    ]
    dense.append(np.ones_like(grid.vignette))
    patches: list[Window | NDArray[np.bool_]] = []
    if missing.any():
        patches.append(abs(grid.rows) @ missing @ abs(grid.columns).T > 0)
    patches += [_window(rig.camera, panel, dent) for dent in panel.dents]
    for patch in patches:
        exact = sight(rig, panel, still(grid.rays[patch].reshape(-1, 3)), photometry)
        for part, values in zip(dense, exact, strict=True):
            part[patch] = values.reshape(part[patch].shape)
    return tuple(dense)


def _window(lens: Lens, panel: Panel, feature: Feature) -> Window:
    """Part of the image that may show a feature, empty where it is out of the image."""
    # A ray that slants at 70 degrees meets a bulge three heights before the bare skin.
    half = feature.reach + 3 * feature.rise
    offsets = [(i * half, j * half) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    x, y = (np.array([feature.x, feature.y]) + offsets).T
    height, _, _ = panel.bare_height(x, y)
    points = panel.pose.apply(np.stack([x, y, height], axis=-1))
    if (points[:, 2] <= 0).any():
        return slice(0, lens.height), slice(0, lens.width)
    pixels = lens.project(points)
    size = lens.width, lens.height
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - _AROUND, 0, size)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + _AROUND + 1, 0, size)
    return slice(low[1], high[1]), slice(low[0], high[0])


def _on_fitting(
    grid: PixelGrid, lens: Lens, panel: Panel, fitting: Feature, reach: int
) -> NDArray[np.intp]:
    """Flat indices of the pixels within `reach` pixels of what is sharp on a fitting."""
    window = _window(lens, panel, fitting)
    rays = grid.rays[window]
    hits = panel.hit_bare(np.zeros(3), rays.reshape(-1, 3))
    _, x, y = (part.reshape(rays.shape[:2]) for part in hits)
    steps = (np.hypot(np.diff(x, axis=i), np.diff(y, axis=i)) for i in (0, 1))
    pixel = max(step.max(initial=0.0) for step in steps)
    rows, columns = np.nonzero(within(fitting, fitting.sharp + reach * pixel, x, y))
    return (rows + window[0].start) * lens.width + columns + window[1].start
