"""The surface that is looked at: panels with a form, dents and fittings, in one frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.fields import Checked, NotNegative, Positive, Quadruple
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.dents import Dent
from ftp_dent_ros.simulation.fittings import Fitting
from ftp_dent_ros.simulation.paint import Paint, Sunlight

Field = NDArray[np.float64]

# The part of a cylinder's radius that a panel may reach sideways.
_WIDEST = 0.9
_ITERATIONS = 12
_CONVERGED = 1e-11

# Every so many pixels it is looked where a mark is.
_COARSE = 8

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]


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


def cylinder(radius: float, x: Field) -> tuple[Field, Field]:
    """Height of ``R - sqrt(R^2 - x^2)`` and its derivative; a radius of 0 is flat."""
    if not radius:
        return np.zeros_like(x), np.zeros_like(x)
    root = np.sqrt(np.maximum(radius**2 - x * x, 1e-12))
    # R - sqrt(R^2 - x^2) without its cancellation.
    return x * x / (radius + root), x / root


def height(radius: float, waves: Iterable[Wave], x: Field, y: Field) -> tuple[Field, Field, Field]:
    """Height of a cylinder with waves, and its derivatives along x and y."""
    rise, along_x = cylinder(radius, x)
    along_y = np.zeros_like(rise)
    for wave in waves:
        more, slope_x, slope_y = wave.height(x, y)
        rise, along_x, along_y = rise + more, along_x + slope_x, along_y + slope_y
    return rise, along_x, along_y


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
    rivets : tuple of Fitting
        Rivets.
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
    rivets: tuple[Fitting, ...] = ()
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
    def features(self) -> tuple[Dent | Fitting, ...]:
        """Dents and fittings."""
        return (*self.dents, *self.rivets)

    def near(self, x: Field, y: Field, margin: float = 0.0) -> Panel:
        """The same panel with only those features that may touch the box around (x, y)."""
        if not self.features:
            return self
        if not len(x):
            return replace(self, dents=(), rivets=())
        centre_x, centre_y, reach = self._bounds
        reach = reach + margin
        touched = (centre_x > x.min() - reach) & (centre_x < x.max() + reach)
        touched &= (centre_y > y.min() - reach) & (centre_y < y.max() + reach)
        count = len(self.dents)
        return replace(
            self,
            dents=tuple(compress(self.dents, touched[:count])),
            rivets=tuple(compress(self.rivets, touched[count:])),
        )

    def covered(self, x: Field, y: Field, margin: float | Field) -> NDArray[np.bool_]:
        """Mask of panel coordinates of shape (n,) that a feature, widened by `margin`, covers."""
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
        return height(self.cylinder_radius, self.waves, x, y)

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

    def normal(self, x: Field, y: Field, bare: bool = False) -> Field:
        """Unit normals out of the aircraft in the parent frame, shape (n, 3).

        Those of the skin without its features if `bare`.
        """
        _, along_x, along_y = self.bare_height(x, y) if bare else self.height(x, y)
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
            scale = self._on_waves(start, along, scale)
        return scale, start[0] + scale * along[0], start[1] + scale * along[1]

    def _on_waves(self, start: Field, along: Field, scale: Field) -> Field:
        """Move hits of the cylinder, at `scale`, onto the waves."""
        with np.errstate(invalid='ignore', divide='ignore'):
            for _ in range(_ITERATIONS):
                px, py, pz = start.reshape(3, -1) + scale * along
                height, along_x, along_y = self.bare_height(px, py)
                slope = along[2] - along_x * along[0] - along_y * along[1]
                step = (pz - height) / slope
                scale = scale - step
                if not np.nanmax(np.abs(step), initial=0.0) >= _CONVERGED:
                    break
        return scale

    def hit_features(
        self, origin: Field, rays: Field, scale: Field, x: Field, y: Field
    ) -> tuple[Field, Field, Field]:
        """Move the hits of `hit_bare` onto the dents and fittings, in place.

        Raises no error where a ray grazes a feature: twelve Newton steps then are the best guess.
        """
        # A hit moves sideways by the depth times the ray's slope, which is 3 at 70 degrees.
        margin = 3 * max((feature.rise for feature in self.features), default=0.0)
        near = np.flatnonzero(self.covered(x, y, margin))
        if len(near):
            origin = np.broadcast_to(origin, rays.shape)[near]
            start, along = self._in_panel(origin, rays[near])
            s = scale[near]
            for _ in range(_ITERATIONS):
                px, py, pz = start + s * along
                height, along_x, along_y = self.height(px, py)
                slope = along[2] - along_x * along[0] - along_y * along[1]
                step = (pz - height) / slope
                s = s - step
                if np.abs(step).max() < _CONVERGED:
                    break
            scale[near] = s
            x[near], y[near], _ = start + s * along
        return scale, x, y

    def _in_panel(self, origin: Field, rays: Field) -> tuple[Field, Field]:
        """Origin, shape (3,) or (3, n), and rays, shape (3, n), in the panel's frame."""
        to_panel = self.pose.rotation.as_matrix().T
        return to_panel @ (origin - self.pose.translation).T, to_panel @ rays.T

    @cached_property
    def _bounds(self) -> Field:
        """Centre and half side of each feature's square, shape (3, number of features)."""
        return np.array([(f.x, f.y, f.reach + 3 * f.rise) for f in self.features]).T

    def _footprints(self, x: Field, y: Field) -> Iterator[tuple[Dent | Fitting, NDArray[np.intp]]]:
        for feature in self.features:
            at = np.flatnonzero(feature.covers(x, y))
            if len(at):
                yield feature, at


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


def is_even(surface: Surface) -> bool:
    """Whether no panel has marks or sun."""
    return not any(panel.paint.marks or panel.sunlight for panel in surface.panels)


def paint_and_sun(
    surface: Surface, tone: NDArray[np.uint8], x: Image, y: Image, sharp_only: bool = False
) -> tuple[Image, Image]:
    """Factor on the albedo and sunlight at points of a surface.

    Parameters
    ----------
    surface : Surface
    tone : ndarray of uint8
        As in `View`: which panel is seen.
    x, y : ndarray
        Coordinates on that panel, metres, of the same shape.
    sharp_only : bool
        Marks that change over many pixels are left out.

    Returns
    -------
    factor : ndarray, shape (1 or 3, ...), float32
        On the albedo of all colours, or of red, green and blue.
    sun : ndarray, shape (...), float32
    """
    coloured = any(panel.paint.coloured for panel in surface.panels)
    factor = np.ones((3 if coloured else 1, *tone.shape), np.float32)
    sun = np.zeros(tone.shape, np.float32)
    for index, panel in enumerate(surface.panels):
        if not (panel.paint.marks or panel.sunlight):
            continue
        on_panel = tone // 2 == index
        if not on_panel.any():
            continue
        everywhere = bool(on_panel.all())
        for mark in panel.paint.marks:
            if sharp_only and mark.smooth:
                continue
            part = _around(mark.box, x, y)
            if part is None:
                continue
            values = mark.factor(x[part], y[part])
            at: Any = (slice(None), *part)
            target = factor[at]
            np.multiply(target, values, out=target, where=everywhere or on_panel[part])
        for light in panel.sunlight:
            np.add(sun, light.at(x, y), out=sun, where=everywhere or on_panel)
    return factor, sun


def smooth_paint(surface: Surface, tone: NDArray[np.uint8], x: Image, y: Image) -> Image:
    """Factor of the marks that change over many pixels, shape of `x`, float32."""
    factor = np.ones(tone.shape, np.float32)
    for index, panel in enumerate(surface.panels):
        for mark in panel.paint.marks:
            if mark.smooth:
                np.multiply(factor, mark.factor(x, y), out=factor, where=tone // 2 == index)
    return factor


def _around(
    box: tuple[float, float, float] | None, x: Image, y: Image
) -> tuple[slice, ...] | None:
    """Part of an image of panel coordinates that may lie in a box (x, y, half side)."""
    whole = (slice(None),) * x.ndim
    if box is None or x.ndim == 1:
        return whole
    centre_x, centre_y, half = box
    coarse = x[::_COARSE, ::_COARSE], y[::_COARSE, ::_COARSE]
    inside = (np.abs(coarse[0] - centre_x) < half) & (np.abs(coarse[1] - centre_y) < half)
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if not len(rows):
        # It may lie between the pixels that were looked at.
        step = max(float(np.nanmax(np.abs(np.diff(part)))) for part in coarse)
        return None if half > step else _around((centre_x, centre_y, 2 * step), x, y)
    return tuple(
        slice(max((at[0] - 1) * _COARSE, 0), (at[-1] + 2) * _COARSE) for at in (rows, columns)
    )
