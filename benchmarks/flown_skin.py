"""Clouds of a marked skin as a camera that flies along it sees them, without any rendering."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose

ROWS, COLUMNS, SPACING, DISTANCE = 110, 170, 0.002, 0.8
RADIUS = 2.0
NOISE = 5e-6
STATED = np.diag([0.03**2] * 3 + [0.015**2] * 3)
# Of the paint's picture, metres a pixel.
_FINE = 0.001


@dataclass(frozen=True, eq=False)
class FlownSkin:
    """A cylinder about x, bent away from a camera above it, with dents and paint.

    `marked` is the part of x that has paint; elsewhere the skin is bare and smooth. With a `pitch`
    the paint is rows of rivets alone, which repeat themselves along x. A `lap` is a y from which
    on the skin lies higher, and by how much.
    """

    seed: int
    marked: tuple[float, float] = (-9.0, 9.0)
    dents: tuple[tuple[float, float, float, float], ...] = ()
    pitch: float | None = None
    lap: tuple[float, float] | None = None
    paint: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        paint = np.zeros((800, 3000))
        for scale in (4, 12, 40):
            small = rng.normal(size=(800 // scale, 3000 // scale))
            grain = cv2.resize(small, (3000, 800), interpolation=cv2.INTER_CUBIC)
            paint += 0.03 * grain / grain.std()
        x = np.arange(3000) * _FINE - 1.5
        for at in np.arange(-1.4, 1.4, 0.025):
            for line in rng.uniform(150, 650, 1):
                cv2.circle(paint, (int((at + 1.5) / _FINE), int(line)), 3, -0.25, -1)
        if self.pitch:
            paint = np.zeros((800, 3000))
            for line in rng.uniform(250, 550, 4):
                for at in np.arange(-1.4, 1.4, self.pitch):
                    cv2.circle(paint, (round((at + 1.5) / _FINE), int(line)), 3, -0.25, -1)
        paint *= (x > self.marked[0]) & (x < self.marked[1])
        object.__setattr__(self, 'paint', paint)

    def height(self, x: NDArray, y: NDArray) -> NDArray:
        z = np.sqrt(RADIUS**2 - y**2) - RADIUS
        if self.lap:
            z = z + np.where(y > self.lap[0], self.lap[1], 0)
        for at_x, at_y, width, depth in self.dents:
            r = np.hypot(x - at_x, y - at_y) / (width / 2)
            z = z - depth * np.where(r < 1, np.square(1 - np.square(np.minimum(r, 1))), 0)
        return z

    def seen(self, pose: Pose, seed: int) -> Cloud:
        """Cloud in the camera's frame, with the image of its skin."""
        rng = np.random.default_rng([self.seed, seed])
        u, v = np.meshgrid(
            (np.arange(COLUMNS) - (COLUMNS - 1) / 2) * SPACING / DISTANCE,
            (np.arange(ROWS) - (ROWS - 1) / 2) * SPACING / DISTANCE,
        )
        rays = np.stack([u, v, np.ones_like(u)], axis=-1)
        along = pose.rotation.apply(rays.reshape(-1, 3)).reshape(rays.shape)
        depth = np.full(u.shape, DISTANCE)
        for _ in range(8):
            point = pose.translation + depth[..., None] * along
            depth = (
                depth
                + (self.height(point[..., 0], point[..., 1]) - point[..., 2]) / (along[..., 2])
            )
        point = pose.translation + depth[..., None] * along
        place = [(point[..., 1] + 0.4) / _FINE, (point[..., 0] + 1.5) / _FINE]
        paint = map_coordinates(self.paint, place, order=1, mode='nearest')
        light = 150 * np.exp(paint) / (1 + u * u + v * v) ** 2
        skin = np.clip(np.rint(light + rng.normal(0, 0.7, u.shape)), 1, 255).astype(np.uint8)
        depth = depth + cv2.GaussianBlur(rng.normal(0, 5 * NOISE, u.shape), (0, 0), 1.5)
        points = (rays * depth[..., None]).astype(np.float32)
        sigma = np.full(u.shape, NOISE, np.float32)
        return Cloud(points, np.full(u.shape, 60, np.float32), sigma, 3e-3 + 0 * sigma, skin=skin)

    def flight(self, count: int, start: float = 0.0, step: float = 0.05, y: float = 0.0):
        """True poses of a pass, with sway and wobble."""
        rng = np.random.default_rng([self.seed, 7, round(1e3 * abs(y)), count])
        for index in range(count):
            sway, wobble = rng.normal(0, 0.004, 3), rng.normal(0, 0.006, 3)
            place = np.array([start + step * index, y, DISTANCE]) + sway
            down = Rotation.from_euler('x', np.pi)
            yield Pose(Rotation.from_rotvec(wobble) * down, place)


def erring(poses: list[Pose], seed: int, seconds: float = 0.5) -> list[Pose]:
    """What an autopilot says of poses: off by a wander as large as `STATED`."""
    rng = np.random.default_rng([seed, 3])
    keep = np.exp(-seconds / 10)
    error = rng.multivariate_normal(np.zeros(6), STATED)
    stated = []
    for pose in poses:
        error = keep * error + np.sqrt(1 - keep**2) * rng.multivariate_normal(np.zeros(6), STATED)
        turn = Rotation.from_rotvec(error[3:])
        stated.append(Pose(turn * pose.rotation, pose.translation + error[:3]))
    return stated
