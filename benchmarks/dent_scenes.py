"""The scenes of the benchmark of dents."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scenes import (
    DAYLIGHT,
    FIELD,
    LIVERY,
    NEAR,
    SCENES,
    Scene,
    fuselage,
    make_rig,
    scene,
    wide,
)

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import Dent, Panel, Rivet, Surface

NOISY = {'full_well': 6000.0, 'read_noise': 1.5}
SMALL = Dent(0.012, -0.006, 0.020, 0.020, 0.0003)
FIELD_DENTS = (
    Dent(-0.07, -0.025, 0.04, 0.04, 0.002),
    Dent(0.075, -0.03, 0.06, 0.025, 0.0008, math.radians(25)),
)
TOUCHING = Dent(-0.02, 0.0, 0.04, 0.04, 0.001), Dent(0.017, 0.003, 0.04, 0.03, 0.0015)


def aircraft(distance: float, *dents: Dent, radius: float = 2.0, rivets: bool = True) -> Panel:
    """Glossy skin with a row of rivets, or part of that."""
    row = tuple(Rivet(-0.3 + 0.025 * i, 0.07) for i in range(25)) if rivets else ()
    panel = fuselage(distance)
    return replace(panel, dents=dents, rivets=row, cylinder_radius=radius)


def miscalibrated(rig: Rig, shift: float) -> Rig:
    """The same rig, its projector believed to be so many radians further round."""
    turn = Pose.from_rpy((0, shift, 0), (0, 0, 0)).rotation.as_matrix()
    return replace(rig, rotation=turn @ rig.rotation, translation=turn @ rig.translation)


def lap_scene(name: str, height: float, *dents: Dent, **light) -> Scene:
    """Two skins, the left one on the right one, with the rivets of the joint."""
    rivets = tuple(Rivet(-0.012, 0.025 * i) for i in range(-10, 11))
    below = replace(aircraft(0.8, *dents), rivets=())
    pose = below.pose
    above = Pose(pose.rotation, pose.translation + pose.rotation.apply([0, 0, -height]))
    upper = Panel(above, (-0.6, 0.0, -0.6, 0.6), 2.0, below.paint, rivets=rivets)
    whole = scene(name, FIELD, below, **light)
    return replace(whole, panels=(upper, replace(below, extent=(-0.05, 0.6, -0.6, 0.6))))


SAMPLE_SCENES = tuple(
    one
    for one in SCENES
    if any(word in one.name for word in ('A,', 'B,', 'C,', 'D,', 'fuselage'))
    and 'Bayer' not in one.name
)
MORE = (
    scene('two beside a rivet row', FIELD, aircraft(0.8, *FIELD_DENTS)),
    scene('the same, daylight', FIELD, aircraft(0.8, *FIELD_DENTS), **DAYLIGHT),
    scene('the same, ambient 0.5', FIELD, aircraft(0.8, *FIELD_DENTS), exposure=0.6, ambient=0.5),
    scene(
        'the same, livery',
        FIELD,
        replace(aircraft(0.8, *FIELD_DENTS), paint=replace(LIVERY, roughness=0.2)),
    ),
    scene('the same, noise', FIELD, aircraft(0.8, *FIELD_DENTS), full_well=3000.0, read_noise=2.0),
    scene('the same, gamma', FIELD, aircraft(0.8, *FIELD_DENTS), camera_gamma=2.2),
    scene(
        '2 mm x 60 mm, 150 cm',
        make_rig(1.5, 0.35, (1920, 1080, 2740.0), 1950.0),
        wide(Dent(0.01, 0.0, 0.06, 0.06, 0.002), 1.5),
    ),
    scene('0.3 mm x 20 mm', NEAR, wide(SMALL, 0.6)),
    scene('touching', FIELD, aircraft(0.8, *TOUCHING)),
    scene('cut by the frame', FIELD, aircraft(0.8, Dent(0.0, -0.175, 0.06, 0.05, 0.002))),
    lap_scene('lap of 1.2 mm', 0.0012, Dent(0.08, 0.0, 0.04, 0.03, 0.001)),
)


def moved(one: Scene, rng: np.random.Generator) -> Scene:
    """The scene from nearby."""
    by = Pose.from_rpy(rng.normal(0, 0.03, 3), rng.normal(0, 0.008, 3))
    return replace(one, panels=Surface(one.panels).transformed(by).panels)


def riveted(rng: np.random.Generator) -> Scene:
    """Glossy skin without dents, turned by up to 20 degrees, with a row or two of rivets."""
    rows = ((-0.085, 0.08), (0.07,), (0.115,), (0.0,))[rng.integers(4)]
    rivets = tuple(Rivet(-0.3 + 0.025 * i, y) for i in range(25) for y in rows)
    panel = aircraft(0.8)
    paint = replace(panel.paint, roughness=float(rng.choice([0.2, 0.3])))
    turn = Pose.from_rpy(rng.normal(0, 0.12, 3), (0, 0, 0)).rotation
    pose = Pose(panel.pose.rotation * turn, panel.pose.translation + rng.normal(0, 0.01, 3))
    panel = replace(panel, rivets=rivets, paint=paint, pose=pose)
    return scene('riveted', FIELD, panel, **(NOISY if rng.integers(2) else {}))
