"""A second renderer, slow and plain, that shares only `Rig` and numbers with the first.

Every pixel is the mean over a dense grid of points on it and of instants; each ray is marched to
the skin by bisection, its projector pixel comes of cv2.projectPoints, and the light there is the
exact blur of square projector pixels.
"""

import math

import cv2
import numpy as np
from scipy.special import erf

# Projector pixels to either side whose light reaches a point: 0.7 px of blur need no more.
_REACH = 4


class PlainPanel:
    """A panel given by numbers: rotation and origin in the camera's frame, radius, dents."""

    def __init__(self, rotation, origin, extent, radius=0.0, dents=(), albedo=0.8, edge=None):
        self.rotation, self.origin, self.extent = np.array(rotation), np.array(origin), extent
        self.radius, self.dents, self.albedo, self.edge = radius, dents, albedo, edge

    def height(self, x, y):
        height = np.zeros_like(x)
        if self.radius:
            height = self.radius - np.sqrt(self.radius**2 - x**2)
        for cx, cy, length, width, depth, angle in self.dents:
            along = math.cos(angle) * (x - cx) + math.sin(angle) * (y - cy)
            across = -math.sin(angle) * (x - cx) + math.cos(angle) * (y - cy)
            r2 = (2 * along / length) ** 2 + (2 * across / width) ** 2
            inside = r2 < 1
            bell = np.exp(-1 / (1 - np.where(inside, r2, 0.0))) * math.e
            height = height + np.where(inside, depth * bell, 0.0)
        return height

    def to_panel(self, points):
        return (points - self.origin) @ self.rotation

    def intersect(self, rays, nearest=0.3, farthest=1.2):
        """Scale of each ray at which it passes through the skin, by bisection."""
        low, high = np.full(len(rays), nearest), np.full(len(rays), farthest)
        for _ in range(32):
            middle = (low + high) / 2
            x, y, z = self.to_panel(middle[:, None] * rays).T
            behind = z > self.height(x, y)
            high, low = np.where(behind, middle, high), np.where(behind, low, middle)
        return (low + high) / 2

    def normal(self, x, y):
        """Unit normals towards the viewer in the camera's frame, by differences."""
        step = 1e-6
        dx = (self.height(x + step, y) - self.height(x - step, y)) / (2 * step)
        dy = (self.height(x, y + step) - self.height(x, y - step)) / (2 * step)
        normal = np.stack([dx, dy, -np.ones_like(dx)], axis=1)
        return (normal / np.linalg.norm(normal, axis=1)[:, None]) @ self.rotation.T


def camera_rays(lens, pixels):
    """Rays with z = 1 through pixels of shape (n, 2), by OpenCV."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-14)
    undistort = getattr(cv2, 'undistortPointsIter', None)
    pixels = np.asarray(pixels, float).reshape(-1, 1, 2)
    matrix, distortion = lens.camera_matrix, lens.distortion
    if undistort:
        ideal = undistort(pixels, matrix, distortion, None, None, criteria)
    else:
        ideal = cv2.undistortPoints(pixels, matrix, distortion, criteria=criteria)
    return np.column_stack([ideal.reshape(-1, 2), np.ones(len(ideal))])


def projector_pixels(rig, points):
    """Projector pixels of points of shape (n, 3) in the camera's frame, by OpenCV."""
    turn, _ = cv2.Rodrigues(rig.rotation)
    lens = rig.projector
    pixels, _ = cv2.projectPoints(
        points.reshape(-1, 1, 3), turn, rig.translation, lens.camera_matrix, lens.distortion
    )
    return pixels.reshape(-1, 2)


def light_at(projected, u, v, sigma, black, gamma=1.0):
    """Light of square pixels blurred by a Gaussian, at projector pixels (n,): shape (n, 3)."""

    def near(position, count):
        """Indices of the pixels around positions, padded by one dark pixel, and their shares."""
        pixel = np.rint(position).astype(int)[:, None] + np.arange(-_REACH, _REACH + 1)
        edges = np.concatenate([pixel - 0.5, pixel[:, -1:] + 0.5], axis=1) - position[:, None]
        shares = np.diff(erf(edges / (math.sqrt(2) * sigma)), axis=1) / 2
        return np.clip(pixel, -1, count) + 1, shares

    level = black + (1 - black) * (projected / 255.0) ** gamma
    level = np.pad(level, ((1, 1), (1, 1), (0, 0)))
    (rows, row_shares), (columns, column_shares) = (
        near(v, len(projected)),
        near(u, level.shape[1] - 2),
    )
    light = np.zeros((len(u), 3))
    for i in range(2 * _REACH + 1):
        for j in range(2 * _REACH + 1):
            share = row_shares[:, i] * column_shares[:, j]
            light += share[:, None] * level[rows[:, i], columns[:, j]]
    return light


def photograph(rig, projected, panel, photometry, fine=6, moments=(0.0,), velocity=(0, 0, 0)):
    """Grey levels, not rounded, shape (height, width, 3), without noise or camera blur.

    The panel is `moments` times `velocity` away from its place at each of the instants.
    """
    camera = rig.camera
    offsets = (np.arange(fine) + 0.5) / fine - 0.5
    v, u, dv, du = np.meshgrid(
        np.arange(camera.height), np.arange(camera.width), offsets, offsets, indexing='ij'
    )
    rays = camera_rays(camera, np.column_stack([(u + du).ravel(), (v + dv).ravel()]))
    shape = (camera.height, camera.width, fine * fine, 3)
    home = panel.origin
    total = np.zeros((*shape[:2], 3))
    for moment in moments:
        panel.origin = home + moment * np.array(velocity)
        total += _shine(rig, projected, panel, photometry, rays).reshape(shape).mean(axis=2)
    panel.origin = home
    axis = camera_rays(camera, np.column_stack([u[..., 0, 0].ravel(), v[..., 0, 0].ravel()]))
    vignette = np.linalg.norm(axis, axis=1) ** -4 if photometry.shading else np.ones(len(axis))
    total *= vignette.reshape(*shape[:2], 1) / len(moments)
    return np.clip(255 * photometry.exposure * total, 0, 255)


def _shine(rig, projected, panel, photometry, rays):
    points = panel.intersect(rays)[:, None] * rays
    x, y, _ = panel.to_panel(points).T
    x_min, x_max, y_min, y_max = panel.extent
    on_skin = (x > x_min) & (x < x_max) & (y > y_min) & (y < y_max)
    u, v = projector_pixels(rig, points).T
    light = light_at(
        projected,
        u,
        v,
        photometry.defocus_px,
        photometry.projector_black,
        photometry.projector_gamma,
    )
    centre = -rig.rotation.T @ rig.translation
    way = points - centre
    distance = np.linalg.norm(way, axis=1)
    if photometry.shading:
        way /= distance[:, None]
        lit = np.maximum(-np.sum(panel.normal(x, y) * way, axis=1), 0)
        lit *= (photometry.reference_distance / distance) ** 2 / (way @ rig.rotation[2])
    else:
        lit = np.ones(len(points))
    albedo = np.full(len(points), panel.albedo)
    if panel.edge:
        n_x, n_y, offset, beyond = panel.edge
        albedo[n_x * x + n_y * y > offset] = beyond
    albedo[~on_skin] = 0
    return albedo[:, None] * (light * lit[:, None] + photometry.ambient)
