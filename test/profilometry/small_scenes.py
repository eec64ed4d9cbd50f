"""Small scenes of the project's simulation, and how far a cloud is off them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation import Dent, Paint, Panel, Photometry, Renderer, Surface

PATTERN = Pattern(640, 480, 8.0, 320.0)
DEPTH = 0.65


def lens(focal: float, k1: float = 0.0) -> Lens:
    matrix = np.array([[focal, 0, 322.5], [0, focal + 2, 237.5], [0, 0, 1]])
    return Lens(640, 480, matrix, np.array([k1, 0.0, 0.0, 0.0, 0.0]))


RIG = Rig(
    lens(900.0),
    lens(940.0),
    Rotation.from_euler('y', 0.3).as_matrix(),
    np.array([-0.2, 0.005, 0.03]),
)
DISTORTED = replace(RIG, camera=lens(900.0, -0.12), projector=lens(940.0, -0.05))
# The projector hangs upside down: its columns run against the camera's.
FLIP = Rotation.from_euler('z', np.pi).as_matrix()
INVERTED = replace(RIG, rotation=FLIP @ RIG.rotation, translation=FLIP @ RIG.translation)

DENT = Dent(0.005, -0.004, length=0.06, width=0.04, depth=0.002, angle=0.4)


def panel(tilt=(0.0, 0.05), half=0.09, centre=(0.004, -0.003), dents=(DENT,), **parts) -> Panel:
    """A square panel, turned about the camera's x and y axes (radians)."""
    pose = Pose.from_rpy((*tilt, 0.0), (*centre, DEPTH))
    return Panel(pose, (-half, half, -half, half), dents=dents, **parts)


@dataclass(frozen=True, eq=False)
class Scene:
    """What is photographed, by which rig, and the photograph."""

    rig: Rig
    surface: Surface
    image: NDArray[np.uint8]

    @classmethod
    def of(
        cls, *panels: Panel, rig: Rig = RIG, projected=None, motion=None, **photometry
    ) -> Scene:
        surface = Surface(panels)
        light = Photometry(reference_distance=DEPTH, **photometry)
        pixels = PATTERN.draw() if projected is None else projected
        image = Renderer(rig, pixels, light).render(surface, motion=motion)
        return cls(rig, surface, image)

    def lit(self) -> NDArray[np.bool_]:
        """Pixels whose surface the projector's panel reaches."""
        points = self.rig.camera.rays(self.rig.camera.pixel_grid())
        points *= self.surface.intersect(points)[..., None]
        u, v = np.moveaxis(self.rig.projector.project(self.rig.to_projector(points)), -1, 0)
        return (u > 0) & (u < PATTERN.width - 1) & (v > 0) & (v < PATTERN.height - 1)

    def errors_mm(self, cloud: Cloud) -> NDArray[np.float64]:
        """Distance of each measured point to the true surface."""
        return 1e3 * np.abs(self.surface.distance(cloud.points[cloud.valid]))


SCENES = {
    'flat': lambda: Scene.of(panel()),
    'tilted left': lambda: Scene.of(panel(tilt=(0.0, np.radians(20)))),
    'tilted right': lambda: Scene.of(panel(tilt=(0.0, np.radians(-20)))),
    'tilted up': lambda: Scene.of(panel(tilt=(np.radians(20), 0.0))),
    'cylinder': lambda: Scene.of(panel(cylinder_radius=1.0)),
    'distorted': lambda: Scene.of(panel(half=0.2), rig=DISTORTED),
    'inverted': lambda: Scene.of(panel(), rig=INVERTED),
    'two tones': lambda: Scene.of(
        panel(paint=Paint((0.8, 0.2, 0.15), (1.0, 0.3, 0.03), (0.4, 0.4, 0.45)))
    ),
    'dim and ambient': lambda: Scene.of(panel(), exposure=0.3, ambient=0.2),
}
