"""Clouds as a photograph gives them: a bent skin on a lens's rays, with holes and noise."""

import cv2
import numpy as np
import pytest

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.coding.cloud_codec import RayGrid
from ftp_dent_ros.rig.rig import Lens

NOISE = 4e-6  # m


def skin(view: RayGrid, seed: int = 1, distance: float = 0.8) -> Cloud:
    """A cylinder with dents, holes, a step, and uncertainties that grow towards the edges."""
    rng = np.random.default_rng(seed)
    x, y = view.rays().astype(float)
    depth = distance + 0.1 * x + 0.15 * x**2 + 0.02 * (y > 0.1)
    depth -= 2e-3 * np.exp(-((x - 0.1) ** 2 + y**2) / 1e-3)
    sigma = NOISE * (1 + 4 * (x**2 + y**2))
    # Smoothed over some pixels, as a reconstruction's is.
    noise = cv2.GaussianBlur(rng.standard_normal(depth.shape), (0, 0), 1.5)
    depth = depth + sigma * noise / noise.std()
    for _ in range(20):
        row, column = (rng.integers(0, size) for size in depth.shape)
        depth[row : row + 9, column : column + 12] = np.nan
    depth[:, :7] = np.nan
    depth[:3] = np.nan
    points = np.stack([x * depth, y * depth, depth], axis=2)
    valid = np.isfinite(depth)
    return Cloud(
        points.astype(np.float32),
        np.where(valid, 40 + 10 * np.cos(3 * x) + noise, 0).astype('f4'),
        np.where(valid, sigma, np.nan).astype(np.float32),
        np.where(valid, 4e-3 * (1 + x**2), np.nan).astype(np.float32),
    )


@pytest.fixture(scope='session')
def view() -> RayGrid:
    """Rays of a distorted camera of 640x360 pixels, at every second one."""
    matrix = np.array([[850.0, 0, 321.35], [0, 852.0, 178.6], [0, 0, 1]])
    return RayGrid(Lens(640, 360, matrix, np.array([-0.085, 0.04, 0.0006, -0.0004, 0.01])), 2)


@pytest.fixture(scope='session')
def cloud(view: RayGrid) -> Cloud:
    return skin(view)
