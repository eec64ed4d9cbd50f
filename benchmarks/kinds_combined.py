"""Kinds that combine what others have alone: edges of light, dirt, laps, fittings and dents.

None was there when the package was built; each is a function of a random generator.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from kind_scenes import (
    Kind,
    KindScene,
    by_contour,
    hail,
    lap_panels,
    scene,
    seed,
    skin,
    three_dents,
)

from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.simulation import (
    Dirt,
    DomedRivet,
    Paint,
    Patch,
    Sunlight,
    waviness,
)
from ftp_dent_ros.simulation.dents import Gaussian, Plate


def sun_dirt_lap(rng: np.random.Generator) -> KindScene:
    """The sun's edge over a dirty lap."""
    turn = rng.uniform(0, math.pi)
    sun = Sunlight(0.5, (1.0, rng.uniform(-0.6, 0.6), rng.uniform(-0.05, 0.05)), 0.003)
    paint = Paint(marks=(Dirt(0.2, seed=seed(rng)),))
    upper, lower, wall = lap_panels(rng, rng.uniform(0.0008, 0.0025), turn)
    lit = (replace(panel, sunlight=(sun,), paint=paint) for panel in (upper, lower))
    return scene(*lit, wall, exposure=0.6)


def patch_in_dent(rng: np.random.Generator) -> KindScene:
    """Dents of which a patch of paint covers a half, a corner or a spot."""
    dents = three_dents(rng)
    a, b, c = dents
    tint = tuple(rng.uniform(0.35, 0.6) * np.array([1, 0.95, 0.9]))
    marks = (
        Patch(a.x + 0.03, a.y, 0.06, 0.08, tint, rng.uniform(-0.3, 0.3)),
        Patch(b.x + 0.03, b.y + 0.03, 0.06, 0.06, tint, rng.uniform(0, 1)),
        Patch(c.x, c.y, 0.012, 0.012, tint, 0.0, True),
    )
    return scene(skin(rng, dents=dents, paint=Paint(marks=marks)))


def at_the_frame(rng: np.random.Generator) -> KindScene:
    """Dents that the picture's rim cuts, and some that touch it from within."""
    dents = tuple(
        by_contour(x, y, w, w, d, 0.0, shape)
        for x, y, w, d, shape in (
            (-0.245, rng.uniform(-0.05, 0.05), 0.05, 0.0010, Gaussian()),
            (rng.uniform(-0.1, 0.0), 0.165, 0.04, 0.0006, Gaussian()),
            (-0.10, -0.15, 0.03, 0.0004, Gaussian()),
            (0.05, -0.152, 0.035, 0.0007, Plate()),
            (0.08, 0.02, 0.03, 0.0003, Gaussian()),
        )
    )
    return scene(skin(rng, dents=dents))


def at_the_light(rng: np.random.Generator) -> KindScene:
    """A frame of light that is smaller than the view, and dents that its rims cut."""
    rig = make_rig(0.8, 0.24, (1280, 720, 1400.0), 2600.0)
    # The frame of light is 0.39 m wide and 0.22 m high, about the middle.
    dents = tuple(
        by_contour(x, y, w, w, d, 0.0, Gaussian())
        for x, y, w, d in (
            (-0.19, rng.uniform(-0.05, 0.05), 0.05, 0.0010),
            (0.20, rng.uniform(-0.04, 0.06), 0.04, 0.0006),
            (0.0, -0.11, 0.04, 0.0006),
            (0.06, 0.02, 0.03, 0.0003),
        )
    )
    return scene(skin(rng, dents=dents), rig=rig)


def coloured_patches(rng: np.random.Generator) -> KindScene:
    """Patches of red, blue, green and yellow paint, some over dents, through a Bayer filter."""
    dents = three_dents(rng)
    paints = (0.9, 0.12, 0.1), (0.12, 0.2, 0.85), (0.15, 0.75, 0.2), (1.0, 0.85, 0.15)
    places = (dents[0].x + 0.02, dents[0].y), (dents[1].x, dents[1].y + 0.015), (-0.13, 0.05)
    marks = tuple(
        Patch(*place, rng.uniform(0.04, 0.08), rng.uniform(0.03, 0.06), paint, rng.uniform(0, 3))
        for place, paint in zip((*places, (0.14, -0.06)), rng.permutation(paints), strict=True)
    )
    return scene(skin(rng, dents=dents, paint=Paint(marks=marks)), bayer=True)


def nested(rng: np.random.Generator) -> KindScene:
    """A small dent in a large one, a bump at another's rim, and a bulge."""
    dents = (
        by_contour(-0.06, 0.0, 0.10, 0.09, 0.0015, 0.0, Plate()),
        by_contour(-0.05, 0.01, 0.018, 0.018, 0.0005, 0.0, Gaussian()),
        by_contour(0.08, -0.03, 0.04, 0.04, -0.0008),
        by_contour(0.08, 0.05, 0.035, 0.035, 0.0008, 0.0, Gaussian()),
        by_contour(0.115, 0.05, 0.02, 0.02, -0.0003, 0.0, Gaussian()),
    )
    return scene(skin(rng, dents=dents))


def deep(rng: np.random.Generator) -> KindScene:
    """Dents of 3 to 8 mm with flanks of up to 35 degrees."""
    dents = (
        by_contour(-0.09, 0.0, 0.07, 0.06, rng.uniform(0.005, 0.008), rng.uniform(0, 3)),
        by_contour(0.06, 0.04, 0.04, 0.035, rng.uniform(0.003, 0.005), 0.0, Gaussian()),
        by_contour(0.06, -0.06, 0.03, 0.03, 0.0003, 0.0, Gaussian()),
    )
    return scene(skin(rng, dents=dents))


def livery(rng: np.random.Generator) -> KindScene:
    """White against black paint, hail on waves, and the edge of a soft shadow."""
    edge = (1.0, rng.uniform(-0.5, 0.5), rng.uniform(0.0, 0.05))
    paint = Paint((0.8,) * 3, edge, (0.06, 0.06, 0.07))
    sun = Sunlight(0.4, (rng.uniform(-0.3, 0.3), 1.0, rng.uniform(-0.03, 0.03)), 0.006)
    panel = skin(
        rng,
        dents=hail(rng, 10, 0.2e-3),
        paint=paint,
        sunlight=(sun,),
        waves=waviness(5e-5, rng.uniform(0.1, 0.2), seed(rng)),
    )
    return scene(panel, exposure=0.65)


def phone(rng: np.random.Generator) -> KindScene:
    """A phone's curve and JPEG on a dirty lap with rivets."""
    panels = lap_panels(rng, rng.uniform(0.001, 0.002), rng.uniform(0, math.pi))
    paint = Paint(marks=(Dirt(0.1, seed=seed(rng)),))
    marked = (replace(panel, paint=paint) for panel in panels)
    options = {'camera_gamma': 2.2, 'jpeg_quality': 75, 'bayer': True}
    return scene(*marked, **options)


def crossed_shadows(rng: np.random.Generator) -> KindScene:
    """Two shadows that cross on a dent, one sharp and one soft, and rivets domed by 1.2 mm."""
    dents = three_dents(rng)
    middle = dents[0]
    suns = []
    for soft in (0.0, 0.008):
        turn = rng.uniform(0, 2 * math.pi)
        n = math.cos(turn), math.sin(turn)
        suns.append(Sunlight(0.35, (*n, n[0] * middle.x + n[1] * middle.y), soft))
    rivets = tuple(DomedRivet(-0.2 + 0.025 * i, 0.005) for i in range(17))
    panel = skin(rng, dents=dents, sunlight=tuple(suns), rivets=rivets)
    return scene(panel, exposure=0.5)


def level_edges(rng: np.random.Generator) -> KindScene:
    """A wing's shadow whose edge is level, across dents, and a level band of dark paint."""
    dents = three_dents(rng)
    sun = Sunlight(
        rng.uniform(0.3, 0.9),
        (rng.uniform(-0.1, 0.1), 1.0, dents[0].y + rng.uniform(-0.01, 0.01)),
        rng.choice([0.0, 0.006, 0.015]),
    )
    band = Patch(0.0, dents[1].y + 0.015, 0.6, 0.03, (rng.uniform(0.1, 0.5),) * 3)
    panel = skin(rng, dents=dents, sunlight=(sun,), paint=Paint(marks=(band,)))
    return scene(panel, exposure=0.55)


COMBINED: dict[str, Kind] = {
    'level_edges': level_edges,
    'sun_dirt_lap': sun_dirt_lap,
    'patch_in_dent': patch_in_dent,
    'at_the_frame': at_the_frame,
    'at_the_light': at_the_light,
    'coloured_patches': coloured_patches,
    'nested': nested,
    'deep': deep,
    'livery': livery,
    'phone': phone,
    'crossed_shadows': crossed_shadows,
}
