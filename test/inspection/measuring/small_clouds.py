"""Small clouds of known surfaces, with noise as fringe windows correlate it."""

import cv2
import numpy as np

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation import Panel, Surface

ROWS, COLUMNS = 150, 200
PIXEL = 1 / 500


def panel(*dents, radius=0.0, rivets=(), tilt=(0.1, -0.15), extent=(-0.6, 0.6, -0.6, 0.6)):
    """Skin 0.7 m in front of the camera."""
    pose = Pose.from_rpy((*tilt, 0.05), (0.002, -0.003, 0.7))
    return Panel(pose, extent, radius, dents=dents, rivets=rivets)


def cloud_of(*panels, noise=5e-6, seed=0):
    """Cloud in the camera's frame, points 1.4 mm apart."""
    v, u = np.mgrid[:ROWS, :COLUMNS]
    x, y = (u - (COLUMNS - 1) / 2) * PIXEL, (v - (ROWS - 1) / 2) * PIXEL
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    depth = Surface(panels).intersect(rays) + noise * correlated(seed)
    points = (rays * depth[..., None]).astype(np.float32)
    return Cloud(points, np.full(depth.shape, 80, np.float32))


def correlated(seed):
    """Noise of variance 1."""
    white = np.random.default_rng(seed).normal(size=(ROWS + 16, COLUMNS + 16))
    return cv2.GaussianBlur(white, (0, 0), 1.5)[8:-8, 8:-8] * (2 * np.sqrt(np.pi) * 1.5)


def raised(cloud, depths):
    """The cloud with points further away by so many metres, as if nothing but that had changed."""
    return Cloud(cloud.points * (1 + depths[..., None] / 0.7).astype(np.float32), cloud.intensity)
