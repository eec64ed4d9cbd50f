"""The scenes of the accuracy benchmark: what is photographed, by which rig, in which light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.evaluation import scenes as evaluation
from ftp_dent_ros.evaluation.scenes import PATTERN, SAMPLES, make_rig
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import (
    Dent,
    Motion,
    Paint,
    Panel,
    Photometry,
    Rivet,
)

CAMERA = 1920, 1080


@dataclass(frozen=True, eq=False)
class Scene(evaluation.Scene):
    """One photograph to take."""

    name: str = ''

    def on_dents(self, points: NDArray) -> NDArray[np.bool_]:
        """Mask of the points of shape (n, 3) that lie on dents."""
        mask = np.zeros(len(points), bool)
        for panel in self.panels:
            x, y, z = panel.pose.inverse().apply(points).T
            height, _, _ = panel.bare_height(x, y)
            for dent in panel.dents:
                mask |= dent.covers(x, y) & (np.abs(z - height) < 0.01)
        return mask


NEAR = make_rig(0.6, 0.23, (*CAMERA, 2740.0), 1870.0)
FAR = make_rig(1.2, 0.27, (*CAMERA, 2740.0), 2020.0)
FIELD = make_rig(0.8, 0.24, (*CAMERA, 2290.0), 1810.0)
BENT = make_rig(
    0.6,
    0.23,
    (*CAMERA, 2290.0),
    1870.0,
    (-0.12, 0.05, 8e-4, -6e-4, 0.0),
    (-0.05, 0.02, -5e-4, 7e-4, 0.0),
)


def tile(dent: Dent, distance: float, tilt: Sequence[float] = (2.0, -3.0)) -> Panel:
    """Sample of the paper, tilted about the camera's x and y axes by so many degrees."""
    pose = Pose.from_rpy((*np.radians(tilt), 0.02), (0.003, -0.002, distance))
    return Panel(pose, (-0.075, 0.075, -0.075, 0.075), dents=(dent,))


def fuselage(distance: float) -> Panel:
    """Glossy skin with a vertical axis, two dents and two rows of rivets."""
    dents = Dent(-0.06, 0.02, 0.05, 0.035, 0.0015, 0.7), Dent(0.09, -0.035, 0.08, 0.05, 0.001, 2.1)
    rows = [Rivet(-0.3 + 0.025 * i, y) for i in range(25) for y in (-0.085, 0.08)]
    pose = Pose.from_rpy((0.02, 0.03, -0.015), (0.005, 0.0, distance))
    paint = Paint(roughness=0.2)
    return Panel(pose, (-0.6, 0.6, -0.6, 0.6), 2.0, paint, dents, tuple(rows))


def scene(name: str, rig: Rig, panel: Panel, speed: float = 0.0, **photometry) -> Scene:
    """Scene of a panel that moves along x during an exposure of 10 ms, metres a second."""
    distance = float(panel.pose.translation[2])
    light = replace(Photometry(reference_distance=distance), **photometry)
    motion = Motion(translation=np.array([0.01 * speed, 0, 0]))
    return Scene(rig, (panel,), light, motion, name)


def steps() -> tuple[Scene, ...]:
    """Two panels that fill the frame, one behind the other, cut upright or across."""
    fringe = 8 * 0.8**2 / (1810 * 0.24)
    scenes = []
    for name, step in (('5 cm', 0.05), ('1/2', 0.5 * fringe), ('3/2', 1.5 * fringe)):
        for cut in ('upright', 'across'):
            extents = (-0.6, 0.05, -0.6, 0.6), (0.05, 0.6, -0.6, 0.6)
            if cut == 'across':
                extents = tuple(extent[2:] + extent[:2] for extent in extents)
            panels = tuple(
                Panel(Pose.from_rpy((0, 0, 0), (0, 0, distance)), extent)
                for distance, extent in zip((0.77, 0.77 + step), extents, strict=True)
            )
            light = Photometry(reference_distance=0.8)
            scenes.append(Scene(FIELD, panels, light, name=f'step {name} {cut}'))
    return tuple(scenes)


def wide(dent: Dent, distance: float) -> Panel:
    """A panel that fills the frame."""
    return replace(tile(dent, distance), extent=(-0.9, 0.9, -0.9, 0.9))


LIVERY = Paint(edge=(0.7, 0.714, 0.012), albedo_beyond=(0.25, 0.25, 0.25))
# Around a contrast of 30 %, and noisy.
DAYLIGHT = {'exposure': 0.28, 'ambient': 2.0, 'full_well': 6000.0, 'read_noise': 1.5}
CLEAN = {'full_well': 1e9, 'read_noise': 0.0}
NOISY_PHASE = 0.6 * PATTERN.period_px / (2 * math.pi)
LIGHTS = {
    'speckle 0.10': {'speckle_contrast': 0.10},
    'speckle 0.15': {'speckle_contrast': 0.15},
    'daylight': DAYLIGHT,
    'gamma': {'camera_gamma': 2.2},
    'Bayer, JPEG': {'bayer': True, 'jpeg_quality': 90},
}
BIASES = ((0.6, 0.015, 10), (0.6, 0.015, 20), (0.6, 0.030, 10), (1.0, 0.020, 10), (1.0, 0.020, 20))

SCENES = (
    *(scene(f'{name}, 60 cm', NEAR, tile(dent, 0.6)) for name, dent in SAMPLES.items()),
    *(
        scene(f'{name}, 120 cm, moving', FAR, tile(dent, 1.2), speed=0.1)
        for name, dent in SAMPLES.items()
    ),
    scene('fuselage, 80 cm', FIELD, fuselage(0.8)),
    *(
        scene(f'A, 60 cm, tilted {x} {y}', NEAR, tile(SAMPLES['A'], 0.6, (x, y)))
        for x, y in ((20, 0), (-20, 0), (0, 20), (0, -20), (0, 35), (0, -35))
    ),
    scene('A, 60 cm, distorted', BENT, tile(SAMPLES['A'], 0.6)),
    scene('fuselage, 60 cm, distorted', BENT, fuselage(0.6)),
    *(
        scene(f'{name}, 60 cm, {light}', NEAR, tile(SAMPLES[name], 0.6), **values)
        for light, values in LIGHTS.items()
        for name in 'AC'
    ),
    *(
        scene(f'fuselage, {light}', FIELD, fuselage(0.8), **LIGHTS[light])
        for light in ('gamma', 'Bayer, JPEG')
    ),
    scene('A, 60 cm, livery', NEAR, replace(tile(SAMPLES['A'], 0.6), paint=LIVERY)),
    scene('A, livery, wide', FIELD, replace(wide(SAMPLES['A'], 0.8), paint=LIVERY)),
    *(
        scene(f'A, {100 * distance:.0f} cm, one rig', FIELD, wide(SAMPLES['A'], distance))
        for distance in (0.4, 0.6, 0.9, 1.2, 1.5)
    ),
    *steps(),
    *(
        scene(
            f'{1e3 * width:.0f} mm, 1:{ratio}, {100 * distance:.0f} cm',
            NEAR if distance < 0.8 else FAR,
            wide(Dent(0.003, 0.002, width, width, width / ratio), distance),
            **CLEAN,
        )
        for distance, width, ratio in BIASES
    ),
    scene(
        'section 3, noisy phase',
        FAR,
        wide(Dent(0.003, 0.002, 0.03, 0.03, 0.003), 1.0),
        shading=False,
        phase_noise_px=NOISY_PHASE,
        **CLEAN,
    ),
)
