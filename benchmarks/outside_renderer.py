"""Photographs by another renderer than the package's own: rays, Newton's method, plain sums.

It shares with the package what a rig, a lens and a pattern are, and nothing of how light is
worked out, so that what both believe of the world is seen where they differ. A world is made of
functions, which makes it easy to put light, surfaces and sensors into it that the package's
simulation does not know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from outside_parts import Array, Dimple, Hits, Screen

from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.rig.rig import Rig

DISTANCE = 0.8
RIG = make_rig(DISTANCE, 0.24, (800, 450, 1200.0), 1890.0)
PATTERN = Pattern(1280, 720, 12.0, 640.0)
# Width of a fringe on the skin, metres.
FRINGE = PATTERN.period_px / 1890.0 * DISTANCE
# Beyond this depth nothing reflects, metres.
_FAR = 4.0
# Samples of a pixel along each axis.
_SAMPLES = 3
# Rows that OpenCV remaps at once.
_REMAPPED = 30_000
# Standard deviation of the projector's blur, its pixels, and light of its black pixels.
_BLUR, _BLACK = 0.7, 0.01


def flat(x: Array, y: Array, moment: Array | float) -> Array:
    """A panel tilted by two degrees or so."""
    return DISTANCE + 0.03 * x - 0.02 * y


def slide(drawn: NDArray[np.float32]) -> NDArray[np.float32]:
    """What an ordinary projector makes of its image, 0 to 1."""
    return np.float32(_BLACK) + np.float32(1 - _BLACK) * cv2.GaussianBlur(drawn, (0, 0), _BLUR)


@dataclass(frozen=True, eq=False)
class World:
    """What is before the rig, by functions of places on the skin in the camera's frame, metres.

    Attributes
    ----------
    skin : callable
        Depth at x and y, at a moment: -0.5 to 0.5 exposures, from when the middle row was seen.
    dimples : tuple of Dimple
    albedo : callable
        Of (n, 2) places: (n, 3), or (n, 1) of grey.
    gloss, roughness : float
        Light of a highlight's middle over that of a white skin, and the lobe's width, radians.
    ambient : callable
        Light from elsewhere on (n, 2) places and sensor rows (n,).
    lamp : callable
        Factor on the projector's light at its (u, v) and the sensor's rows: (n, 3) or (n, 1).
    slide : callable
        What the projector makes of its image, of shape (rows, columns, 3).
    more : callable, optional
        Light of `Hits` by other ways, (n, 3).
    bend : callable, optional
        From `Hits`, by how much light comes from beside: (n, 3) metres.
    screens : tuple of Screen
    things : tuple of (x, y, radius)
        What stands on the skin and may be listed: metres.
    exposure : float
    drift : tuple of float
        Way of the skin, with all that is on it, to the right and down in an exposure, metres.
    readout : float
        Exposures that pass between the first row and the last.
    rig : Rig
    pattern : Pattern
    """

    skin: Callable[[Array, Array, Array | float], Array] = flat
    dimples: tuple[Dimple, ...] = ()
    albedo: Callable[[Array], Array] = lambda place: np.full((len(place), 1), 0.75)
    gloss: float = 0.0
    roughness: float = 0.1
    ambient: Callable[[Array, Array], Array | float] = lambda place, rows: 0.03
    lamp: Callable[[Array, Array, Array], Array | float] = lambda u, v, rows: 1.0
    slide: Callable[[NDArray[np.float32]], NDArray[np.float32]] = slide
    more: Callable[[World, Hits], Array] | None = None
    bend: Callable[[World, Hits], Array] | None = None
    screens: tuple[Screen, ...] = ()
    things: tuple[tuple[float, float, float], ...] = ()
    exposure: float = 1.0
    drift: tuple[float, float] = (0.0, 0.0)
    readout: float = 0.0
    rig: Rig = field(default_factory=lambda: RIG)
    pattern: Pattern = PATTERN

    def begun(self, rows: Array) -> Array | float:
        """Exposures from the middle row's moment to that of rows of the sensor."""
        return self.readout * (rows / self.rig.camera.height - 0.5) if self.readout else 0.0

    def depth(self, x: Array, y: Array, moment: Array | float = 0.0) -> Array:
        """Depth of the dented skin."""
        x, y = x - self.drift[0] * moment, y - self.drift[1] * moment
        return self.skin(x, y, moment) + sum(d.height(x, y) for d in self.dimples)

    def meet(
        self, rays: Array, moment: Array | float = 0.0, start: Array | float = DISTANCE
    ) -> Array:
        """z where rays of z = 1, shape (n, 3), meet the skin, by Newton's method; NaN far away."""
        x, y = rays[:, 0], rays[:, 1]
        z = np.full(len(rays), start) if np.isscalar(start) else np.array(start)
        for _ in range(8 if np.isscalar(start) else 3):
            miss = self.depth(x * z, y * z, moment) - z
            further = self.depth(x * (z + 1e-6), y * (z + 1e-6), moment) - z - 1e-6
            slope = (further - miss) / 1e-6
            z = np.clip(z - miss / np.where(np.abs(slope) < 0.05, -1, slope), 0.2, _FAR)
        met = np.abs(self.depth(x * z, y * z, moment) - z) < 1e-6
        return np.where(met & (z < 0.9 * _FAR), z, np.nan)

    def normals(self, points: Array, moment: Array | float = 0.0) -> Array:
        """Unit normals towards the camera."""
        x, y, e = points[:, 0], points[:, 1], 1e-5
        across = (self.depth(x + e, y, moment) - self.depth(x - e, y, moment)) / (2 * e)
        along = (self.depth(x, y + e, moment) - self.depth(x, y - e, moment)) / (2 * e)
        normal = np.stack([across, along, -np.ones_like(across)], axis=1)
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def hits(self, points: Array, normals: Array, rows: Array, moment: Array | float) -> Hits:
        """Where light comes from at points."""
        centre = self.rig.projector_centre
        lamp = centre - points
        squared = np.einsum('ij,ij->i', lamp, lamp)
        u, v = self.rig.projector.project(self.rig.to_projector(points)).T
        unit = lamp / np.sqrt(squared)[:, None]
        view = -points / np.linalg.norm(points, axis=1, keepdims=True)
        return Hits(points, normals, view, unit, squared, u, v, rows, moment)

    def shadow(self, points: Array) -> NDArray[np.bool_]:
        """Points that a screen hides from the projector."""
        dark = np.zeros(len(points), bool)
        centre = self.rig.projector_centre
        for screen in self.screens:
            part = (screen.distance - points[:, 2]) / (centre[2] - points[:, 2])
            place = points + part[:, None] * (centre - points)
            behind = points[:, 2] > screen.distance + 1e-4
            dark |= behind & screen.covers(place[:, 0], place[:, 1])
        return dark

    def seen(self, rays: Array, moment: Array | float = 0.0, start: Array | float = DISTANCE):
        """Points of shape (n, 3), normals, and which screen is met; 0 for the skin, -1 nothing."""
        z = self.meet(rays, moment, start)
        points = rays * z[:, None]
        normals = self.normals(np.nan_to_num(points, nan=1.0), moment)
        what = np.where(np.isfinite(z), 0, -1)
        for number, screen in enumerate(self.screens, 1):
            place = rays * screen.distance
            met = screen.covers(place[:, 0], place[:, 1])
            points[met], normals[met], what[met] = place[met], (0, 0, -1), number
        return points, normals, what


def photograph(world: World) -> NDArray[np.float32]:
    """Light on the sensor, shape (rows, columns, 3): 1 saturates; no lens's blur, no noise."""
    camera = world.rig.camera
    image = world.slide(world.pattern.draw().astype(np.float32) / 255)
    grid = camera.pixel_grid().reshape(-1, 2)
    offsets = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    total = np.zeros((len(grid), 3))
    start: Array | float = DISTANCE
    # The moments go through the samples in an order that no direction shares.
    moments = (np.argsort([4, 0, 7, 2, 8, 3, 6, 1, 5]) + 0.5) / _SAMPLES**2 - 0.5
    for number, (du, dv) in enumerate((a, b) for a in offsets for b in offsets):
        rays = camera.rays(grid + np.array([du, dv]))
        moment = moments[number] + world.begun(grid[:, 1])
        points, normals, what = world.seen(rays, moment, start)
        total += _light(world, image, points, normals, what, grid[:, 1], moment)
        z = world.meet(rays, moment, start) if world.screens else points[:, 2]
        start = np.nan_to_num(z, nan=DISTANCE)
    return (total / _SAMPLES**2).reshape(camera.height, camera.width, 3).astype(np.float32)


def _light(world, image, points, normals, what, rows, moment) -> Array:
    """Light that rays bring, (n, 3)."""
    points = np.where(what[:, None] >= 0, points, 1.0)
    hits = world.hits(points, normals, rows, moment)
    if world.bend is not None:
        hits = world.hits(points + world.bend(world, hits), normals, rows, moment)
    lit = projected(image, hits.u, hits.v) * world.lamp(hits.u, hits.v, rows)
    lit *= DISTANCE**2 / hits.squared_distance[:, None]
    lit[world.shadow(points)] = 0
    facing = np.clip(np.einsum('ij,ij->i', hits.normals, hits.lamp), 0, None)[:, None]
    place = points[:, :2] - np.multiply.outer(moment, world.drift)
    albedo = np.broadcast_to(world.albedo(place), lit.shape)
    for number, screen in enumerate(world.screens, 1):
        albedo = np.where(what[:, None] == number, screen.albedo, albedo)
    around = np.broadcast_to(np.asarray(world.ambient(points[:, :2], rows)).T, lit.T.shape).T
    light = albedo * (lit * facing + around)
    if world.gloss:
        turn = np.arccos(hits.half())
        light += world.gloss * np.exp(-((turn / world.roughness) ** 2))[:, None] * lit
    if world.more is not None:
        light += world.more(world, hits)
    light[what < 0] = 0
    return world.exposure * light


def projected(image: NDArray[np.float32], u: Array, v: Array) -> Array:
    """Light of the projector's image at places of it, (n, 3); none beside it."""
    columns, rows = (np.asarray(a, np.float32)[:, None] for a in (u, v))
    light = [
        cv2.remap(
            image,
            columns[first : first + _REMAPPED],
            rows[first : first + _REMAPPED],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
        )
        for first in range(0, len(columns), _REMAPPED)
    ]
    return np.concatenate(light).reshape(-1, 3).astype(float)
