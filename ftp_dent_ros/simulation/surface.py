"""The surface that is looked at: panels with a form, dents and rivets, in one frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.fields import Checked, NotNegative, Positive, Quadruple
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.dents import Dent, Feature, Field, Rivet, within
from ftp_dent_ros.simulation.paint import Paint, Sunlight
from ftp_dent_ros.simulation.sensor import Image

# The part of a cylinder's radius that a panel may reach sideways.
_WIDEST = 0.9
_ITERATIONS = 12
_CONVERGED = 1e-11


@dataclass(frozen=True)
class Wave(Checked):
    """A sinusoidal waviness that runs across the whole panel.

    Attributes
    ----------
    amplitude : float
        Metres.
    wavelength : float
        Metres.
    angle : float
        From the panel's x axis to the direction in which it varies, towards y, radians.
    phase : float
        At the panel's origin, radians: ``amplitude * sin(phase)`` there.
    """

    amplitude: float
    wavelength: Positive
    angle: float = 0.0
    phase: float = 0.0

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        number = 2 * math.pi / self.wavelength
        along_x, along_y = number * math.cos(self.angle), number * math.sin(self.angle)
        phase = along_x * x + along_y * y + self.phase
        slope = self.amplitude * np.cos(phase)
        return self.amplitude * np.sin(phase), slope * along_x, slope * along_y


def waviness(
    amplitude: float, wavelength: float, seed: int = 0, count: int = 3
) -> tuple[Wave, ...]:
    """Waves in several directions that add up to an amplitude at most, metres.

    Their wavelengths lie within a quarter of `wavelength`, as those of a skin on its frames do.
    """
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.full(count, 4.0))
    return tuple(
        Wave(
            amplitude * float(share),
            wavelength * float(rng.uniform(0.8, 1.25)),
            float(rng.uniform(0, math.pi)),
            float(rng.uniform(0, 2 * math.pi)),
        )
        for share in shares
    )


@dataclass(frozen=True, eq=False)
class Panel(Checked):
    """A skin panel in some frame.

    Attributes
    ----------
    pose : Pose
        The panel's frame in that frame.
    extent : tuple of 4 floats
        x_min, x_max, y_min, y_max on the panel, metres.
    cylinder_radius : float
        Metres; 0 is flat.
    paint : Paint
    dents : tuple of Dent
    rivets : tuple of Rivet or Dent
        What is fixed to it: it changes within a pixel.
    waves : tuple of Wave
        The undeformed skin's own waviness.
    sunlight : tuple of Sunlight
        Light from elsewhere that falls on parts of it, with that of the photometry.
    """

    pose: Pose
    extent: Quadruple
    cylinder_radius: NotNegative = 0.0
    paint: Paint = field(default_factory=Paint)
    dents: tuple[Dent, ...] = ()
    rivets: tuple[Dent | Rivet, ...] = ()
    waves: tuple[Wave, ...] = ()
    sunlight: tuple[Sunlight, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        x_min, x_max, y_min, y_max = self.extent
        if not (x_min < x_max and y_min < y_max):
            self.refuse('extent', 'x_min < x_max and y_min < y_max')
        if self.cylinder_radius:
            reach = _WIDEST * self.cylinder_radius
            narrowed = max(x_min, -reach), min(x_max, reach), y_min, y_max
            object.__setattr__(self, 'extent', narrowed)

    @property
    def features(self) -> tuple[Feature, ...]:
        """Dents and rivets."""
        return (*self.dents, *self.rivets)

    @property
    def bare(self) -> Panel:
        """The same panel without dents and rivets."""
        return replace(self, dents=(), rivets=())

    def near(self, x: Field, y: Field, margin: float = 0.0) -> Panel:
        """The same panel with only those features that may touch the box around (x, y).

        Places that are NaN are nowhere.
        """
        low_x, low_y = (np.fmin.reduce(each, initial=np.inf) - margin for each in (x, y))
        high_x, high_y = (np.fmax.reduce(each, initial=-np.inf) + margin for each in (x, y))

        def touches(feature: Feature) -> bool:
            half = feature.reach + 3 * feature.rise
            beside = low_x - half < feature.x < high_x + half
            return beside and low_y - half < feature.y < high_y + half

        dents, rivets = tuple(filter(touches, self.dents)), tuple(filter(touches, self.rivets))
        return replace(self, dents=dents, rivets=rivets)

    def covered(self, x: Field, y: Field, margin: float | Field) -> NDArray[np.bool_]:
        """Mask of panel coordinates of shape (n,) within `margin` metres of a feature."""
        mask = np.zeros(len(x), bool)
        for feature in self.features:
            mask |= feature.covers(x, y, margin)
        return mask

    def contains(self, x: Field, y: Field) -> NDArray[np.bool_]:
        """Mask of panel coordinates within the extent."""
        x_min, x_max, y_min, y_max = self.extent
        return (x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)

    def bare_height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height of the skin without features, and its derivatives along x and y."""
        height, along_x, along_y = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
        if self.cylinder_radius:
            root = np.sqrt(np.maximum(self.cylinder_radius**2 - x * x, 1e-12))
            # R - sqrt(R^2 - x^2) without its cancellation.
            height, along_x = x * x / (self.cylinder_radius + root), x / root
        for wave in self.waves:
            more, slope_x, slope_y = wave.height(x, y)
            height, along_x, along_y = height + more, along_x + slope_x, along_y + slope_y
        return height, along_x, along_y

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of shape (n,)."""
        height, along_x, along_y = self.bare_height(x, y)
        for feature, at in self._footprints(x, y):
            rise, slope_x, slope_y = feature.height(x[at], y[at])
            height[at] += rise
            along_x[at] += slope_x
            along_y[at] += slope_y
        return height, along_x, along_y

    def clean(self, x: Field, y: Field) -> Field:
        """Factor of the features on the paint's albedo, shape (n,)."""
        part = np.ones_like(x)
        for feature, at in self._footprints(x, y):
            part[at] *= feature.clean(x[at], y[at])
        return part

    def normal(self, x: Field, y: Field) -> Field:
        """Unit normals out of the aircraft in the parent frame, shape (n, 3)."""
        _, along_x, along_y = self.height(x, y)
        length = np.sqrt(1 + along_x * along_x + along_y * along_y)
        normal = np.stack([along_x, along_y, np.full_like(along_x, -1.0)]) / length
        return (self.pose.rotation.as_matrix() @ normal).T

    def hit_bare(self, origin: Field, rays: Field) -> tuple[Field, Field, Field]:
        """Where rays hit the skin without features, beyond the extent too.

        Parameters
        ----------
        origin : ndarray, shape (3,) or (n, 3)
        rays : ndarray, shape (n, 3)

        Returns
        -------
        scale, x, y : ndarray, shape (n,)
            The hit is at ``origin + scale * rays`` and at (x, y) on the panel; NaN where the ray
            misses or the hit is behind its origin.
        """
        start, along = self._in_panel(origin, rays)
        with np.errstate(all='ignore'):
            if self.cylinder_radius:
                a = along[0] ** 2 + along[2] ** 2
                b = start[0] * along[0] + (start[2] - self.cylinder_radius) * along[2]
                c = start[0] ** 2 + start[2] ** 2 - 2 * self.cylinder_radius * start[2]
                scale = c / (np.sqrt(b * b - a * c) - b)
            else:
                scale = -start[2] / along[2]
            scale = np.where(scale > 0, scale, np.nan)
            if self.waves:
                scale = _moved_onto(self.bare_height, start.reshape(3, -1), along, scale)
        return scale, start[0] + scale * along[0], start[1] + scale * along[1]

    def hit(self, origin: Field, rays: Field) -> tuple[Panel, tuple[Field, Field, Field]]:
        """As `hit_bare` with dents and rivets, and the panel with those that may be hit.

        Where a ray grazes a feature, twelve Newton steps are the best guess.
        """
        scale, x, y = self.hit_bare(origin, rays)
        panel = self.near(x, y)
        # A hit moves sideways by the depth times the ray's slope, which is 3 at 70 degrees.
        near = np.flatnonzero(panel.covered(x, y, 3 * panel.rise))
        if len(near):
            start, along = self._in_panel(np.broadcast_to(origin, rays.shape)[near], rays[near])
            scale[near] = _moved_onto(panel.height, start, along, scale[near])
            x[near], y[near], _ = start + scale[near] * along
        return panel, (scale, x, y)

    @property
    def rise(self) -> float:
        """Largest height of a feature above or below the skin, metres."""
        return max((feature.rise for feature in self.features), default=0.0)

    def _in_panel(self, origin: Field, rays: Field) -> tuple[Field, Field]:
        """Origin, shape (3,) or (3, n), and rays, shape (3, n), in the panel's frame."""
        to_panel = self.pose.rotation.as_matrix().T
        return to_panel @ (origin - self.pose.translation).T, to_panel @ rays.T

    def _footprints(self, x: Field, y: Field) -> Iterator[tuple[Feature, NDArray[np.intp]]]:
        for feature in self.features:
            at = np.flatnonzero(within(feature, feature.reach, x, y))
            if len(at):
                yield feature, at


def _moved_onto(
    height: Callable[[Field, Field], tuple[Field, Field, Field]],
    start: Field,
    along: Field,
    scale: Field,
) -> Field:
    """Move hits at ``start + scale * along``, near a height field, onto it by Newton's steps."""
    for _ in range(_ITERATIONS):
        x, y, z = start + scale * along
        rise, along_x, along_y = height(x, y)
        step = (z - rise) / (along[2] - along_x * along[0] - along_y * along[1])
        scale = scale - step
        if not np.nanmax(np.abs(step), initial=0.0) >= _CONVERGED:
            break
    return scale


def signed_distance(panel: Panel, points: Field) -> Field:
    """Signed distance of points (n, 3) in the panel's parent frame, positive behind the skin.

    The closest point lies within the extent. To 1e-6 m for points within a few millimetres
    of the skin; of points far away the nearest of several dents may be missed.
    """
    at = panel.pose.inverse().apply(points)
    foot = at[:, :2].copy()
    if panel.cylinder_radius:
        below = np.maximum(panel.cylinder_radius - at[:, 2], 1e-9)
        foot[:, 0] *= panel.cylinder_radius / np.hypot(foot[:, 0], below)
    foot = np.clip(foot, panel.extent[::2], panel.extent[1::2])
    distance = _signed(at, foot, panel.bare_height(*foot.T)[0])
    margin = np.abs(distance) + panel.rise
    local = panel.near(foot[:, 0], foot[:, 1], float(margin.max(initial=0.0)))
    near = np.flatnonzero(local.covered(foot[:, 0], foot[:, 1], margin) | bool(panel.waves))
    if len(near):
        distance[near] = _refined(local, at[near], foot[near])
    return distance


def _signed(at: Field, foot: Field, height: Field) -> Field:
    """Distances of points (n, 3) from others on the panel, with the sign of their side."""
    away = at - np.column_stack([foot, height])
    return np.copysign(np.sqrt((away * away).sum(axis=1)), away[:, 2])


def _refined(panel: Panel, at: Field, foot: Field) -> Field:
    """Signed distances of points (n, 3) in the panel's frame, from feet (n, 2) near theirs."""
    best = np.full(len(foot), np.inf)
    # Gauss-Newton on the squared distance, with the curvature of the bare skin added.
    for _ in range(_ITERATIONS):
        height, *slopes = panel.height(*foot.T)
        distance = _signed(at, foot, height)
        best = np.where(np.abs(distance) < np.abs(best), distance, best)
        slope, above = np.stack(slopes, axis=1), at[:, 2] - height
        normal = np.eye(2) + slope[:, :, None] * slope[:, None]
        if panel.cylinder_radius:
            bend = panel.cylinder_radius**2 / (panel.cylinder_radius**2 - foot[:, 0] ** 2) ** 1.5
            normal[:, 0, 0] -= np.minimum(above * bend, 0.8)
        gradient = at[:, :2] - foot + slope * above[:, None]
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        foot = np.clip(foot + step, panel.extent[::2], panel.extent[1::2])
        if np.abs(step).max() < _CONVERGED:
            break
    return best


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

    def intersect(self, rays: ArrayLike) -> NDArray[np.float64]:
        """Where rays from the origin first meet the surface.

        Parameters
        ----------
        rays : ndarray, shape (..., 3)
            Directions; with z = 1 and the origin in the camera, the result is the depth.

        Returns
        -------
        ndarray, shape (...)
            The surface is at ``result * ray``; NaN where the ray meets nothing.
        """
        rays = np.asarray(rays, float)
        flat = rays.reshape(-1, 3)
        met = []
        for panel in self.panels:
            _, (scale, x, y) = panel.hit(np.zeros(3), flat)
            met.append(np.where(panel.contains(x, y), scale, np.nan))
        return np.fmin.reduce(met).reshape(rays.shape[:-1])

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
        each = np.stack([signed_distance(panel, flat[finite]) for panel in self.panels])
        result = np.full(len(flat), np.nan)
        result[finite] = np.take_along_axis(each, np.abs(each).argmin(axis=0)[None], axis=0)[0]
        return result.reshape(points.shape[:-1])


def paint_on(
    surface: Surface,
    tone: NDArray[np.uint8],
    x: Image,
    y: Image,
    kinds: tuple[bool, ...] = (False, True),
) -> Image:
    """Factor of the marks on the albedo of red, green and blue at points of a surface.

    Parameters
    ----------
    surface : Surface
    tone : ndarray of uint8
        As in `View`: which panel is seen.
    x, y : ndarray
        Coordinates on that panel, metres, of the same shape.
    kinds : tuple of bool
        True of the marks that change over many pixels, False of all others.

    Returns
    -------
    ndarray, shape (3, ...), float32
        Of those that change over many pixels, which are grey, shape (1, ...).
    """
    factor = np.ones((3 if False in kinds else 1, *tone.shape), np.float32)
    for index, panel in enumerate(surface.panels):
        for mark in panel.paint.marks:
            near = (np.abs(x - mark.x) < mark.reach) & (np.abs(y - mark.y) < mark.reach)
            at = (tone // 2 == index) & near & (mark.smooth in kinds)
            if at.any():
                factor[:, at] *= mark.factor(x[at], y[at])
    return factor


def sun_on(surface: Surface, tone: NDArray[np.uint8], x: Image, y: Image) -> Image:
    """Sunlight at points of a surface, which `paint_on` explains; shape of `x`, float32."""
    sun = np.zeros(tone.shape, np.float32)
    for index, panel in enumerate(surface.panels):
        for light in panel.sunlight:
            np.add(sun, light.at(x, y), out=sun, where=tone // 2 == index)
    return sun
