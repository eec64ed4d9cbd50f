"""What camera rays see: panel, paint, projector pixel and brightness, ray by ray."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation.photography.motion import Rays
from ftp_dent_ros.simulation.photography.photometry import Photometry
from ftp_dent_ros.simulation.skin.paint import dot
from ftp_dent_ros.simulation.skin.panel import Panel
from ftp_dent_ros.simulation.skin.surface import Surface

# A lens model may fold far outside its image: beyond this part of its corner it casts no light.
_FIELD = 1.2
# A shadow's caster is at least this much nearer to the projector, as a part of the distance.
_CLEAR = 1e-5
# The tone of what is no panel.
NOTHING = 255
# What a view takes over from the sight of the panel that is seen.
_SEEN = ('u', 'v', 'x', 'y', 'diffuse', 'specular', 'clean')
# A projector pixel far outside any image.
_NOWHERE = -1000.0

Field = NDArray[np.float64]


class Sight(NamedTuple):
    """What rays see of one panel, also where it ends: arrays of one shape."""

    scale: Field  # The point is at scale * ray.
    x: Field  # On the panel, metres.
    y: Field
    u: Field  # Projector pixel that lights it.
    v: Field
    diffuse: Field  # Irradiance at full light, 1 for the white patch of the photometry.
    specular: Field  # The same times the varnish's reflectance.
    clean: Field  # Factor of dents and fittings on the albedo.


@dataclass(eq=False)
class View:
    """What rays see of a surface: arrays of one shape.

    Attributes
    ----------
    u, v, x, y, diffuse, specular, clean : ndarray
        As in `Sight`; diffuse and specular are 0 where nothing is lit.
    tone : ndarray of uint8
        Column of `albedo_table` that holds the albedo: twice the panel's index, one more beyond
        its paint's edge, and `NOTHING` where no panel is.
    shadow : ndarray of bool
        Where another panel stands in the projector's way.
    """

    u: NDArray
    v: NDArray
    x: NDArray
    y: NDArray
    diffuse: NDArray
    specular: NDArray
    clean: NDArray
    tone: NDArray[np.uint8]
    shadow: NDArray[np.bool_]


def albedo_table(surface: Surface) -> NDArray[np.float32]:
    """Albedo of every tone that a view can have, shape (3, 256)."""
    table = np.zeros((3, 256), np.float32)
    for index, panel in enumerate(surface.panels):
        table[:, 2 * index] = panel.paint.albedo
        table[:, 2 * index + 1] = panel.paint.albedo_beyond
    return table


def look(rig: Rig, surface: Surface, rays: Rays, photometry: Photometry) -> View:
    """What rays see of a surface that is given in mid-exposure."""
    sights = [sight(rig, panel, rays, photometry) for panel in surface.panels]
    return first_seen(rig, surface, sights, rays.directions)


def sight(rig: Rig, panel: Panel, rays: Rays, photometry: Photometry, bare: bool = False) -> Sight:
    """What rays see of one panel, beyond its extent too; NaN where they miss.

    If `bare`, its dents and fittings are left out.
    """
    scale, x, y = panel.hit_bare(rays.origin, rays.towards)
    if not bare:
        hit = np.isfinite(scale)
        panel = panel.near(x[hit], y[hit])
        panel.hit_features(rays.origin, rays.towards, scale, x, y)
    points = scale[:, None] * rays.directions
    u, v = projector_pixel(rig, points)
    diffuse, specular = _brightness(rig, panel, points, x, y, photometry, bare)
    clean = np.ones_like(x) if bare else panel.clean(x, y)
    return Sight(scale, x, y, u, v, diffuse, specular, clean)


def first_seen(rig: Rig, surface: Surface, sights: list[Sight], rays: NDArray) -> View:
    """Merge the sights of a surface's panels along rays of shape (..., 3): the nearest is seen."""
    first = sights[0]
    nearest = np.full(first.scale.shape, np.inf)
    view = View(
        first.u,
        first.v,
        first.x,
        first.y,
        first.diffuse,
        first.specular,
        first.clean,
        tone=np.full(nearest.shape, NOTHING, np.uint8),
        shadow=np.zeros(nearest.shape, bool),
    )
    for index, (panel, seen) in enumerate(zip(surface.panels, sights, strict=True)):
        closer = panel.contains(seen.x, seen.y) & (seen.scale < nearest)
        np.copyto(nearest, seen.scale, where=closer)
        tone = 2 * index + panel.paint.beyond_edge(seen.x, seen.y).astype(np.uint8)
        np.copyto(view.tone, tone, where=closer)
        if seen is not first:
            for name in _SEEN:
                np.copyto(getattr(view, name), getattr(seen, name), where=closer)
    if len(surface.panels) > 1:
        view.shadow = _shadowed(rig, surface, view.tone, nearest, rays)
    unlit = ~np.isfinite(view.u + view.v)
    view.u[unlit] = view.v[unlit] = _NOWHERE
    unlit |= view.shadow | (view.tone == NOTHING)
    view.diffuse[unlit] = view.specular[unlit] = 0
    return view


def projector_pixel(rig: Rig, points: Field) -> tuple[Field, Field]:
    """Projector pixels that light points of shape (n, 3); NaN where the projector cannot."""
    seen = rig.to_projector(points)
    with np.errstate(all='ignore'):
        radius = np.hypot(seen[:, 0], seen[:, 1]) / seen[:, 2]
        reached = (seen[:, 2] > 0) & (radius < _FIELD * _corner(rig.projector))
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
    rig: Rig, panel: Panel, points: Field, x: Field, y: Field, photometry: Photometry, bare: bool
) -> tuple[Field, Field]:
    """Diffuse and specular brightness of points of shape (n, 3) seen from the camera."""
    to_light = rig.projector_centre - points
    distance = np.sqrt(dot(to_light, to_light))
    to_light /= distance[:, None]
    to_eye = points / -np.sqrt(dot(points, points))[:, None]
    normal = panel.normal(x, y, bare)
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
    seen = np.flatnonzero(tone.ravel() != NOTHING)
    points = scale.ravel()[seen, None] * rays.reshape(-1, 3)[seen]
    owner = tone.ravel()[seen] // 2
    centre = rig.projector_centre
    blocked = np.zeros(len(seen), bool)
    for index, panel in enumerate(surface.panels):
        other = np.flatnonzero(owner != index)
        part, x, y = panel.hit_bare(centre, points[other] - centre)
        blocked[other] |= (part < 1 - _CLEAR) & panel.contains(x, y)
    shadow = np.zeros(tone.size, bool)
    shadow[seen] = blocked
    return shadow.reshape(tone.shape)
