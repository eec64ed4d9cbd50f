"""Synthetic clouds: a true surface seen on a camera's grid, with correlated noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Dent, Panel, Rivet, Surface

# Pixels at stride 2 of a 1280 x 720 camera, and their angle.
GRID = (360, 640)
PIXEL = 1 / 750


def cloud_of(
    surface: Surface,
    noise: float,
    rng: np.random.Generator,
    correlation: float = 3.0,
    grid: tuple[int, int] = GRID,
    pixel: float = PIXEL,
) -> tuple[Cloud, NDArray[np.float32]]:
    """Cloud of a surface in the camera's frame, and the standard deviation of its points.

    The noise is along the rays, metres, smooth over `correlation` pixels as fringe windows make
    it, and grows towards the frame's rim. The windows smooth the surface too, so little that it
    is left out here.
    """
    rows, columns = grid
    v, u = np.mgrid[:rows, :columns]
    x, y = (u - (columns - 1) / 2) * pixel, (v - (rows - 1) / 2) * pixel
    rays = np.stack([x, y, np.ones(grid)], axis=-1)
    deviation = noise * (1 + (u / columns - 0.5) ** 2 + (v / rows - 0.5) ** 2)
    # A margin, so that the rim is as noisy as the rest.
    pad = int(4 * correlation)
    white = rng.normal(size=(rows + 2 * pad, columns + 2 * pad))
    if correlation:
        white = cv2.GaussianBlur(white, (0, 0), correlation)[pad:-pad, pad:-pad]
        white *= 2 * np.sqrt(np.pi) * correlation
    length = np.linalg.norm(rays, axis=-1)
    depth = surface.intersect(rays) + deviation * white / length
    points = (rays * depth[..., None]).astype(np.float32)
    intensity = np.where(np.isfinite(depth), 80, 0).astype(np.float32)
    return Cloud(points, intensity), deviation.astype(np.float32)


def skin(
    distance: float,
    tilt: tuple[float, float] = (0.05, -0.04),
    radius: float = 0.0,
    dents: tuple[Dent, ...] = (),
    rivets: tuple[Rivet, ...] = (),
) -> Panel:
    """A panel that fills the frame, tilted about x and y, radians."""
    pose = Pose.from_rpy((*tilt, 0.03), (0.002, -0.003, distance))
    return Panel(pose, (-0.6, 0.6, -0.6, 0.6), radius, dents=dents, rivets=rivets)


def lap(distance: float, height: float, dents: tuple[Dent, ...] = ()) -> Surface:
    """Two skins, the left one so much nearer: a lap joint with a row of rivets."""
    rivets = tuple(Rivet(-0.012, 0.025 * i) for i in range(-10, 11))
    pose = Pose.from_rpy((0.03, -0.04, 0.1), (0.01, 0, distance))
    above = Pose(pose.rotation, pose.translation + pose.rotation.apply([0, 0, -height]))
    return Surface(
        (
            Panel(above, (-0.6, 0.0, -0.6, 0.6), 2.0, rivets=rivets),
            Panel(pose, (-0.1, 0.6, -0.6, 0.6), 2.0, dents=dents),
        )
    )


def random_dent(rng: np.random.Generator, reach: float = 0.07) -> Dent:
    """A dent from 0.3 to 3 mm deep, anywhere about the middle."""
    length = rng.uniform(0.024, 0.1)
    return Dent(
        x=rng.uniform(-reach, reach),
        y=rng.uniform(-0.6 * reach, 0.6 * reach),
        length=length,
        width=length * rng.uniform(0.4, 0.95),
        depth=float(np.exp(rng.uniform(np.log(0.0003), np.log(0.003)))),
        angle=rng.uniform(0, np.pi),
    )
