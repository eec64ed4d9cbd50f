"""Kinds of rigs and cameras: where the projector stands, how the camera is mounted, its pixels.

None was there when the package was built; each is a function of a random generator.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from kind_scenes import (
    CAMERA,
    PATTERN,
    Kind,
    KindScene,
    across_edge,
    by_contour,
    scene,
    seed,
    skin,
    three_dents,
)
from scipy.spatial.transform import Rotation

from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import Dirt, DomedRivet, Paint, Panel, Sunlight
from ftp_dent_ros.simulation.dents import Gaussian


def mounted(
    distance: float = 0.8,
    baseline: float = 0.24,
    camera: tuple[int, int, float] = CAMERA,
    focal: float = 1890.0,
    bearing: float = 0.0,
    roll: float = 0.0,
    lenses: tuple[Sequence[float], Sequence[float]] = ((0,) * 5, (0,) * 5),
) -> Rig:
    """A rig whose projector looks at the middle of the view.

    Parameters
    ----------
    bearing : float
        Of the projector from the camera: 0 at its right, 90 above it, degrees; it stands upright.
    roll : float
        By which the camera is turned about its axis in its mount, degrees.
    """
    turn = math.radians(bearing)
    centre = np.array([baseline * math.cos(turn), -baseline * math.sin(turn), 0.012])
    z = np.array([0, 0, distance]) - centre
    z /= np.linalg.norm(z)
    x = np.cross([0.01, 1, 0], z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    plain = make_rig(distance, baseline, camera, focal, *lenses)
    rolled = Rotation.from_euler('z', roll, degrees=True).as_matrix()
    return Rig(plain.camera, plain.projector, rotation @ rolled, -rotation @ centre)


def on_rig(spread: float = 3.0, pattern: Pattern = PATTERN, **options) -> Kind:
    """Three dents before a rig as `mounted` makes it."""

    def kind(rng: np.random.Generator) -> KindScene:
        rig, distance = mounted(**options), options.get('distance', 0.8)
        scale = distance / 0.8 * CAMERA[2] / rig.camera.camera_matrix[0, 0]
        # Dents keep their sizes; their places go with the view.
        wide = rig.camera.width * scale, rig.camera.height * scale
        places = (-0.06, -0.05), (0.05, 0.04), (-0.015, 0.1)
        across = ((x * wide[0] / 1280, y * wide[1] / 960) for x, y in places)
        dents = three_dents(rng, *across)
        panel = skin(rng, distance, spread, dents=dents)
        return scene(panel, rig=rig, pattern=pattern)

    return kind


def tilted(turn: tuple[float, float]) -> Kind:
    """Skin seen from aside, by degrees about the camera's x and y axes."""

    def kind(rng: np.random.Generator) -> KindScene:
        angles = np.radians(np.array(turn) * rng.choice([-1, 1]) + rng.uniform(-3, 3, 2))
        places = (-0.08, -0.03), (0.05, 0.03), (-0.01, 0.06)
        pose = Pose.from_rpy((*angles, 0), (0, 0, 0.8))
        return scene(Panel(pose, (-2, 2, -2, 2), dents=three_dents(rng, *places)))

    return kind


def close(rng: np.random.Generator) -> KindScene:
    """A glossy fuselage of 1 m radius at 0.4 m, domed rivets, sun on half of it."""
    rig = make_rig(0.4, 0.12, CAMERA, 1890.0)
    rivets = tuple(DomedRivet(-0.1 + 0.02 * i, 0.012) for i in range(11))
    dents = (
        by_contour(-0.045, -0.02, 0.03, 0.03, 0.001),
        by_contour(0.035, -0.025, 0.02, 0.016, 0.0005, rng.uniform(0, 3)),
        by_contour(-0.01, 0.038, 0.012, 0.012, 0.00025, 0.0, Gaussian()),
    )
    sun = Sunlight(0.5, (1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.02, 0.02)), 0.002)
    panel = skin(
        rng,
        0.4,
        dents=dents,
        rivets=rivets,
        cylinder_radius=1.0,
        paint=Paint(roughness=0.2),
        sunlight=(sun,),
    )
    return scene(panel, rig=rig, exposure=0.6)


def sun_above(rng: np.random.Generator) -> KindScene:
    """A projector above the camera, level fringes, and a level shadow's edge through dents."""
    edge, dents = across_edge(rng)
    turned = tuple(
        by_contour(-d.y, d.x * 0.6, 0.03, 0.03, d.depth, 0.0, Gaussian()) for d in dents
    )
    # A quarter turn, to the right by 0.6 of the way.
    across = (0.0, 1.0, 0.6 * edge[2])
    sun = Sunlight(rng.uniform(0.5, 0.9), across, 0.0)
    panel = skin(rng, dents=turned, sunlight=(sun,))
    return scene(panel, rig=mounted(bearing=90), pattern=LEVEL, exposure=0.5)


def dirty_above(rng: np.random.Generator) -> KindScene:
    """Level fringes on dirt, the projector below the camera."""
    panel = skin(rng, paint=Paint(marks=(Dirt(0.2, seed=seed(rng)),)))
    return scene(panel, rig=mounted(bearing=-90), pattern=LEVEL)


def of_sensor(**options) -> Kind:
    """An ordinary skin before the ordinary rig, seen by some sensor."""
    return lambda rng: scene(skin(rng), **options)


# Level fringes, for a projector above or below the camera.
LEVEL = Pattern(1280, 720, 10.0, 360.0, 'v')
_BARREL = (-0.32, 0.12, 1e-3, -1e-3, 0.0), (-0.15, 0.04, -1e-3, 1e-3, 0.0)

RIGS: dict[str, Kind] = {
    'portrait': on_rig(camera=(720, 1280, 1700.0)),
    'camera_on_its_side': on_rig(roll=90.0),
    'camera_turned_20': on_rig(roll=20.0),
    'projector_above': on_rig(bearing=90.0, pattern=LEVEL),
    'projector_left': on_rig(bearing=180.0),
    'projector_aslant': on_rig(bearing=30.0),
    'sun_above': sun_above,
    'dirty_above': dirty_above,
    'ultra_hd': on_rig(camera=(3840, 2160, 5100.0)),
    'vga': on_rig(camera=(640, 480, 850.0)),
    'fringes_4_px': on_rig(pattern=Pattern(1280, 720, 5.0, 640.0)),
    'fringes_30_px': on_rig(pattern=Pattern(1280, 720, 32.0, 640.0)),
    'baseline_0.5': on_rig(baseline=0.5),
    'baseline_0.1': on_rig(baseline=0.1),
    'barrel': on_rig(camera=(1280, 720, 1000.0), focal=1200.0, lenses=_BARREL),
    'at_2_m': on_rig(distance=2.0, baseline=0.6),
    'tilted_40_right': tilted((0.0, 40.0)),
    'tilted_40_up': tilted((40.0, 0.0)),
    'close': close,
    'bits_16': of_sensor(encoding='rgb16', full_well=30000.0, read_noise=0.3),
    'raw_12': of_sensor(encoding='bayer_grbg12'),
    'sharp': of_sensor(psf_px=0.15, defocus_px=0.1),
    'projector_gamma': of_sensor(projector_gamma=1.15),
}
