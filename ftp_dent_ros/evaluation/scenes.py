"""What the paper photographed: its samples, its two rigs, and the dent of its simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation import CameraMotion, Dent, Panel, Photometry, Renderer, Surface

PATTERN = Pattern(1280, 720, 8.0, 640.0)

# Table 2: tiles of 15 x 15 cm, one dent in the middle.
SAMPLES = {
    'A': Dent(0.0, 0.0, length=0.060, width=0.040, depth=0.002),
    'B': Dent(0.0, 0.0, length=0.120, width=0.100, depth=0.002),
    'C': Dent(0.0, 0.0, length=0.100, width=0.080, depth=0.003),
    'D': Dent(0.0, 0.0, length=0.120, width=0.080, depth=0.001),
}
_STRAIGHT = (0.0,) * 5
SPEED = 0.1  # m/s along x (section 4.2)
EXPOSURE = 0.01  # s


@dataclass(frozen=True, eq=False)
class Scene:
    """A surface in the camera's frame before a rig, and its light.

    Attributes
    ----------
    rig : Rig
    panels : tuple of Panel
    photometry : Photometry
    motion : CameraMotion
    """

    rig: Rig
    panels: tuple[Panel, ...]
    photometry: Photometry
    motion: CameraMotion = field(default_factory=CameraMotion)

    @property
    def surface(self) -> Surface:
        """The panels together."""
        return Surface(self.panels)

    @property
    def dent(self) -> Dent:
        """The first panel's first dent."""
        return self.panels[0].dents[0]

    def photograph(self, seed: int = 0, pattern: Pattern = PATTERN) -> NDArray[np.uint8]:
        """Render it with the noise of a seed."""
        renderer = Renderer(self.rig, pattern.draw(), self.photometry)
        return renderer.render(self.surface, np.random.default_rng(seed), self.motion)

    def lit(self) -> NDArray[np.bool_]:
        """Pixels of the camera whose surface the projector reaches."""
        points = self.rig.camera.rays(self.rig.camera.pixel_grid())
        points *= self.surface.intersect(points)[..., None]
        u, v = np.moveaxis(self.rig.projector.project(self.rig.to_projector(points)), -1, 0)
        return (u > 0) & (u < PATTERN.width - 1) & (v > 0) & (v < PATTERN.height - 1)

    def on_panel(self, points: NDArray[np.floating]) -> tuple[NDArray, NDArray]:
        """Coordinates along the panel from the dent's centre, metres."""
        x, y, _ = np.moveaxis(
            self.panels[0].pose.inverse().apply(np.asarray(points, float)), -1, 0
        )
        return x - self.dent.x, y - self.dent.y


def make_rig(
    distance: float,
    baseline: float,
    camera: tuple[int, int, float],
    projector_focal: float,
    camera_distortion: Sequence[float] = _STRAIGHT,
    projector_distortion: Sequence[float] = _STRAIGHT,
) -> Rig:
    """Camera of (width, height, focal length), and a projector to its right, toed in."""
    turn = Rotation.from_euler('yxz', [math.atan(baseline / distance), 0.021, -0.017])
    rotation = turn.as_matrix()
    width, height, focal = camera
    return Rig(
        _lens(width, height, focal, (8.3, -6.1), camera_distortion),
        _lens(PATTERN.width, PATTERN.height, projector_focal, (-9.2, 17.4), projector_distortion),
        rotation,
        -rotation @ [baseline, -0.009, -0.012],
    )


def _lens(
    width: int,
    height: int,
    focal: float,
    offset: Sequence[float],
    distortion: Sequence[float],
) -> Lens:
    centre_u, centre_v = (width - 1) / 2 + offset[0], (height - 1) / 2 + offset[1]
    matrix = [[focal, 0, centre_u], [0, 1.001 * focal, centre_v], [0, 0, 1]]
    return Lens(width, height, np.array(matrix), np.array(distortion, float))


# Baselines are the paper's (section 4.1 and 4.2); focal lengths it does not give.
STATIC_RIG = make_rig(0.6, 0.235, (1920, 1080, 2740.0), 1870.0)
DYNAMIC_RIG = make_rig(1.2, 0.267, (1920, 1080, 2740.0), 2020.0)
SIMULATED_RIG = make_rig(1.0, 0.235, (1280, 720, 1850.0), 1870.0)


def sample(name: str, rig: Rig, distance: float, speed: float = 0.0) -> Scene:
    """A sample of table 2, tilted a little, at a distance."""
    pose = Pose.from_rpy(np.radians([2.0, -3.0, 1.0]), (0.003, -0.002, distance))
    panel = Panel(pose, (-0.075, 0.075, -0.075, 0.075), dents=(SAMPLES[name],))
    motion = CameraMotion(translation=np.array([EXPOSURE * speed, 0, 0]))
    return Scene(rig, (panel,), Photometry(reference_distance=distance), motion)


def simulated_dent(phase_noise: float = 0.0) -> Scene:
    """Section 3: a dent 3 mm deep and 30 mm wide in a plane at 1 m, without the camera's noise.

    Parameters
    ----------
    phase_noise : float
        Standard deviation of white noise on the phase of the light that each pixel sees, radians.
    """
    dent = Dent(0.0, 0.0, length=0.030, width=0.030, depth=0.003)
    panel = Panel(Pose(Rotation.identity(), np.array([0, 0, 1.0])), (-1, 1, -1, 1), dents=(dent,))
    noise_px = phase_noise * PATTERN.period_px / (2 * np.pi)
    light = Photometry(
        reference_distance=1.0,
        shading=False,
        read_noise=0.0,
        full_well=1e12,
        phase_noise_px=noise_px,
    )
    return Scene(SIMULATED_RIG, (panel,), light)
