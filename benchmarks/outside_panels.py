"""Panels of the outside renderer: three dents in a skin, and what a kind makes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from outside_parts import Dimple
from outside_renderer import World, photograph
from outside_sensors import develop

Generator = np.random.Generator


@dataclass(frozen=True, eq=False)
class Outside:
    """A world, and what the camera makes of its light: options of `develop`."""

    world: World
    sensor: dict[str, Any] = field(default_factory=dict)

    def picture(self, rng: Generator) -> NDArray[np.uint8]:
        """Photograph of 8 bits."""
        return develop(photograph(self.world), rng, **self.sensor)


Kind = Callable[[Generator], Outside]


def three(rng: Generator, *places: tuple[float, float]) -> tuple[Dimple, ...]:
    """1.0 mm x 40 mm, 0.5 mm x 50 x 35 mm and 0.25 mm x 25 mm."""
    places = places or ((-0.11, -0.04), (0.10, 0.03), (-0.02, 0.07))
    a, b, c = (np.array(place) + rng.uniform(-0.01, 0.01, 2) for place in places)
    return (
        Dimple(*a, 0.040, 0.040, 1.0e-3),
        Dimple(*b, 0.050, 0.035, 0.5e-3, rng.uniform(0, math.pi)),
        Dimple(*c, 0.025, 0.025, 0.25e-3),
    )


def plain(rng: Generator, sensor: dict[str, Any] | None = None, **options) -> Outside:
    """Dents in a panel, but for the options."""
    options.setdefault('dimples', three(rng))
    return Outside(World(**options), sensor or {})


def of_sensor(**sensor) -> Kind:
    """An ordinary panel, seen by something."""
    return lambda rng: plain(rng, sensor)
