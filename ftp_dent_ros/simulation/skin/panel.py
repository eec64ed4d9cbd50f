"""One skin panel: flat or part of a cylinder, with its waves, dents, fittings and paint.

Panel frame: x and y along the skin, z into the aircraft. A flat panel is the plane z = 0; a
cylindrical one is ``z = R - sqrt(R^2 - x^2)``: it touches that plane along its y axis, which is
parallel to the cylinder's axis, and bends away from the viewer. Waves, dents and fittings add
to z.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.skin import form
from ftp_dent_ros.simulation.skin.dent import Dent
from ftp_dent_ros.simulation.skin.fitting import Fitting
from ftp_dent_ros.simulation.skin.form import Wave
from ftp_dent_ros.simulation.skin.openings import Opening
from ftp_dent_ros.simulation.skin.paint import Paint
from ftp_dent_ros.simulation.skin.sunlight import Sunlight

# The part of a cylinder's radius that a panel may reach sideways.
_WIDEST = 0.9
_ITERATIONS = 12
_CONVERGED = 1e-11

Field = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Panel:
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
        Rivets of any kind, and beads of sealant.
    waves : tuple of Wave
        The undeformed skin's own waviness.
    openings : tuple of Opening
        Where the panel is cut out.
    sunlight : tuple of Sunlight
        Light from elsewhere that falls on parts of it, with that of the photometry.
    """

    pose: Pose
    extent: tuple[float, float, float, float]
    cylinder_radius: float = 0.0
    paint: Paint = field(default_factory=Paint)
    dents: tuple[Dent, ...] = ()
    rivets: tuple[Fitting, ...] = ()
    waves: tuple[Wave, ...] = ()
    openings: tuple[Opening, ...] = ()
    sunlight: tuple[Sunlight, ...] = ()

    def __post_init__(self) -> None:
        x_min, x_max, y_min, y_max = self.extent
        if not (x_min < x_max and y_min < y_max):
            raise ConfigurationError(
                f'the extent of a panel is {list(self.extent)}: '
                'give x_min < x_max and y_min < y_max'
            )
        radius = self.cylinder_radius
        if radius < 0:
            raise ConfigurationError(
                f'the cylinder_radius of a panel is {radius!r}: give metres, or 0 for a flat one'
            )
        if radius:
            reach = _WIDEST * radius
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
        inside = (x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)
        for opening in self.openings:
            inside &= ~opening.contains(x, y)
        return inside

    def bare_height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height of the skin without features, and its derivatives along x and y."""
        return form.height(self.cylinder_radius, self.waves, x, y)

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
