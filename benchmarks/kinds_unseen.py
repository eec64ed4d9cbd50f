"""Kinds that are held out: no constant, model or interval may be chosen on them.

They judge what was chosen on `kind_scenes.KINDS`. Look at them last, and report them apart; a
change that is made after a look at a kind here moves that kind to `kind_scenes`, and a new one
takes its place. Their rigs, periods, seeds and makings are not those of the kinds in use.
"""

from __future__ import annotations

import math

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
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.simulation import (
    Bead,
    Dirt,
    DomedRivet,
    Lettering,
    Paint,
    Patch,
    Rivet,
    Sunlight,
    scratches,
    waviness,
)
from ftp_dent_ros.simulation.dents import Crater, FlatBottomed, Plate, RaisedCosine, Valley

_RIGS = (
    (make_rig(0.7, 0.20, (1600, 1200, 2100.0), 1750.0), 0.7),
    (make_rig(0.9, 0.30, (1440, 1080, 1900.0), 2200.0, (-0.1, 0.05, 4e-4, -3e-4, 0.0)), 0.9),
    (make_rig(1.1, 0.28, (1920, 1200, 2500.0), 2300.0), 1.1),
)


def unlike(rng: np.random.Generator, spread: float = 8.0, **options) -> KindScene:
    """Another rig, period and stripe; `skin_` options are the panel's, spread that of its tilt."""
    rig, distance = _RIGS[rng.integers(len(_RIGS))]
    period = float(rng.choice([7.3, 9.0, 12.5]))
    pattern = Pattern(1280, 720, period, float(rng.uniform(590, 690)))
    panel = {key[5:]: value for key, value in options.items() if key.startswith('skin_')}
    light = {key: value for key, value in options.items() if not key.startswith('skin_')}
    panel.setdefault('dents', _dents(rng, distance))
    return scene(skin(rng, distance, spread=spread, **panel), rig=rig, pattern=pattern, **light)


def _dents(rng: np.random.Generator, distance: float):
    scale = distance / 0.8
    shapes = RaisedCosine(), FlatBottomed(0.4), Plate()
    places = (-0.09, 0.03), (0.06, -0.04), (0.0, 0.065)
    return tuple(
        by_contour(
            x * scale + rng.uniform(-0.01, 0.01),
            y * scale + rng.uniform(-0.01, 0.01),
            rng.uniform(0.025, 0.06),
            rng.uniform(0.02, 0.025),
            depth,
            rng.uniform(0, 3),
            shape,
        )
        for (x, y), depth, shape in zip(
            places, (0.0008, 0.0004, 0.00025), rng.permuted(shapes), strict=True
        )
    )


def flecks(rng: np.random.Generator) -> KindScene:
    """Sun through slats: several edges at once, of any direction."""
    angle, pitch = rng.uniform(0, math.pi), rng.uniform(0.05, 0.09)
    n = math.cos(angle), math.sin(angle)
    # A slat's light is that beyond one edge less that beyond the next.
    sun = tuple(Sunlight(0.5, (*n, (i - 2) * pitch), rng.uniform(0.001, 0.01)) for i in range(3))
    return unlike(rng, skin_sunlight=sun, exposure=0.5)


def pinstripes(rng: np.random.Generator) -> KindScene:
    """Stripes of paint 2 to 6 mm wide, near the fringe's own pitch, along the fringes."""
    width = rng.uniform(0.002, 0.006)
    marks = tuple(
        Patch(-0.06 + 2.3 * width * i, 0, 0.5, width, (0.6,) * 3, math.pi / 2 + 0.03)
        for i in range(7)
    )
    return unlike(rng, skin_paint=Paint(marks=marks))


def checker(rng: np.random.Generator) -> KindScene:
    """A chequered band, as on tails and targets."""
    size = rng.uniform(0.012, 0.03)
    marks = tuple(
        Patch(-0.1 + size * i, size * (j - 1), size, size, (0.25,) * 3)
        for i in range(8)
        for j in range(3)
        if (i + j) % 2
    )
    return unlike(rng, skin_paint=Paint(marks=marks))


def oily(rng: np.random.Generator) -> KindScene:
    """Blots and runs of oil on dirt."""
    blots = tuple(
        Patch(
            rng.uniform(-0.12, 0.12),
            rng.uniform(-0.08, 0.08),
            rng.uniform(0.01, 0.06),
            rng.uniform(0.004, 0.02),
            (tint, tint * 0.9, tint * 0.75),
            rng.uniform(0, 3),
            True,
        )
        for tint in rng.uniform(0.3, 0.8, 8)
    )
    runs = Dirt(0.25, (0.009,), seed(rng), stretch=15, angle=rng.uniform(0.4, 1.2))
    return unlike(rng, skin_paint=Paint(marks=(runs, *blots)))


def grimy_rows(rng: np.random.Generator) -> KindScene:
    """Rivets with tails of dirt."""
    rivets = tuple(Rivet(-0.15 + 0.022 * i, -0.01, dirt=0.6) for i in range(14))
    tails = tuple(
        Patch(r.x + 0.002, r.y + 0.012, 0.02, 0.003, (0.75,) * 3, 1.4, True) for r in rivets
    )
    return unlike(rng, skin_rivets=rivets, skin_paint=Paint(marks=tails))


def shapes(rng: np.random.Generator) -> KindScene:
    """A crease, a crater and a gouge on skin with light dirt."""
    dents = (
        by_contour(-0.08, 0.0, 0.05, 0.008, 0.0008, rng.uniform(0, 3), Valley(0.06)),
        by_contour(0.05, 0.04, 0.03, 0.03, 0.0006, 0, Crater(0.25, 0.65)),
        by_contour(0.06, -0.04, 0.04, 0.005, 0.0004, rng.uniform(0, 3), Valley(0.2)),
    )
    return unlike(rng, skin_dents=dents, skin_paint=Paint(marks=(Dirt(0.1, seed=seed(rng)),)))


def tight(rng: np.random.Generator) -> KindScene:
    """Skin of half a metre's radius, glossy, with sealant and domed rivets."""
    fittings = (
        Bead(0.0, -0.07, 0.2, angle=rng.uniform(-0.1, 0.1), proud=0.0008),
        *(DomedRivet(-0.1 + 0.03 * i, 0.08, proud=0.0009) for i in range(7)),
    )
    return unlike(
        rng,
        skin_cylinder_radius=0.5,
        skin_rivets=fittings,
        skin_paint=Paint(roughness=0.25),
        ambient=0.2,
        exposure=0.8,
    )


def cheap(rng: np.random.Generator) -> KindScene:
    """A phone's sensor: Bayer, gamma, JPEG 45, crosstalk, blur, and half over-exposed."""
    return unlike(
        rng,
        bayer=True,
        jpeg_quality=45,
        crosstalk=0.1,
        psf_px=1.5,
        camera_gamma=1.8,
        exposure=1.3,
        read_noise=2.0,
    )


def dim(rng: np.random.Generator) -> KindScene:
    """18 DN under daylight, with scratches."""
    marks = scratches(12, (-0.15, 0.15, -0.1, 0.1), seed(rng))
    return unlike(rng, skin_paint=Paint(marks=marks), exposure=0.1, ambient=0.4)


def stepped(rng: np.random.Generator) -> KindScene:
    """A lap of 0.3 to 3 mm at any angle under letters and dirt."""
    panels = lap_panels(rng, rng.uniform(0.0003, 0.003), rng.uniform(0, math.pi))
    return scene(*panels, rig=_RIGS[0][0], reference_distance=0.8, exposure=1.1)


def hailed(rng: np.random.Generator) -> KindScene:
    """Hail on dirty, wavy skin half in the sun."""
    return unlike(
        rng,
        skin_dents=hail(rng, 20, 0.15e-3),
        skin_waves=waviness(8e-5, rng.uniform(0.1, 0.25), seed(rng)),
        skin_paint=Paint(marks=(Dirt(0.2, (0.03, 0.007), seed(rng)),)),
        skin_sunlight=(Sunlight(0.4, (1.0, 0.4, 0.02), 0.002),),
        exposure=0.6,
    )


def labelled(rng: np.random.Generator) -> KindScene:
    """Small print all over, upright and turned."""
    words = 'FUEL', 'HYD PRESS', 'LIFT HERE', 'NO STEP', 'DANGER', 'VENT 12'
    marks = tuple(
        Lettering(
            rng.uniform(-0.12, 0.12),
            rng.uniform(-0.08, 0.08),
            word,
            rng.uniform(0.004, 0.025),
            tuple(rng.uniform(0.05, 0.7, 3)),
            rng.choice([0, math.pi / 2, rng.uniform(0, 3)]),
        )
        for word in words
    )
    return unlike(rng, skin_dents=three_dents(rng), skin_paint=Paint(marks=marks))


UNSEEN: dict[str, Kind] = {
    'u_steep': lambda rng: unlike(rng, spread=28.0),
    'u_flecks': flecks,
    'u_pinstripes': pinstripes,
    'u_checker': checker,
    'u_oil': oily,
    'u_grimy_rivets': grimy_rows,
    'u_shapes': shapes,
    'u_tight': tight,
    'u_cheap_camera': cheap,
    'u_dim_scratched': dim,
    'u_lap': stepped,
    'u_hail': hailed,
    'u_labels': labelled,
}
